"""The library of identified devices: whole, resolvable by name wherever a model is, and the page agrees with it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import mrwarp
from mrwarp.cli import main
from mrwarp.devices.device_page import EQUATIONS, PAGE, PICTURES, ROOT, pages_of, with_numbers
from mrwarp.devices.entry import library, lines, load_device, numbers
from mrwarp.devices.make_entry import PAPER, make_device
from mrwarp.devices.number_picture import HOLDING, LOOP, around, loop
from mrwarp.model_file import load_model
from mrwarp.options.json_file import JsonFileError
from mrwarp.params import MrParams
from mrwarp.recording.load import RecordingError, load_recording
from mrwarp.resources import DEVICES, device_names, model_path

LARGEST_PICTURE = 40_000
"""Bytes: the repository stays light."""


def test_ten_devices_say_what_is_known_of_them() -> None:
    """Law, numbers, range, error on unseen runs, what is left, source with licence, command; no recording."""
    devices = library()
    assert len(devices) >= 10 and PAPER in {d.name for d in devices}
    for d in devices:
        assert {p.name for p in (DEVICES / d.name).iterdir()} == {"model.json", "device.json"}
        assert all(d.stated.values()) and d.measured["held_out"]["rmse"] > 0.0 and d.measured["unexplained"]
        assert d.measured["commands"] and d.measured["range"]["speed"] > 0.0
        assert d.name == PAPER or any(p.ci95 for p in d.model.parameters.values())
        assert numbers(d.model) and any(text.startswith("error on unseen runs") for text in lines(d))


def test_the_pictures_and_the_page_agree_with_the_files() -> None:
    """As ``mrwarp device page --only-check`` says in ``make lint``."""
    pages = pages_of(DEVICES)
    assert len(pages) == 1 + len(device_names())
    assert {path: (ROOT / path).read_text(encoding="utf-8") for path in pages} == pages
    assert f"](devices/{device_names()[0]}.md)" in pages[PAGE]
    sizes = {path.stem: path.stat().st_size for path in (ROOT / PICTURES).glob("*.png")}
    assert tuple(sorted(sizes)) == device_names() and max(sizes.values()) < LARGEST_PICTURE
    assert main(["device", "page", "--only-check"]) == 0


def test_the_page_of_equations_has_every_number() -> None:
    """With unit and default from their definitions: names that ``fit`` prints are explained there."""
    page = (ROOT / EQUATIONS).read_text(encoding="utf-8")
    assert with_numbers(page) == page
    for spec in MrParams.specs():
        assert f"| `{spec.name}` | {spec.doc.replace('|', chr(92) + '|')} | {spec.unit} | {spec.default:.6g} |" in page
    assert with_numbers("a\n<!-- numbers -->\nold\n<!-- /numbers -->\nb").count("\n") == len(MrParams.specs()) + 5


@pytest.mark.parametrize("number", [*LOOP, *HOLDING])
def test_a_number_is_drawn_with_less_and_more_of_it(number: str) -> None:
    """Three values that can be, in order, and each changes the curve that its panel shows."""
    params = MrParams().alone()
    low, own, high = around(params, number, 2.0)
    assert low < own < high and own == params.to_dict()[number]
    variants = [params.replace(**{number: value}) for value in (low, own, high)]
    if number in HOLDING:
        curves = [np.array([x.hold.yield_torque(i) for i in (0.3, 0.8, 1.5)]) for x in variants]
    else:
        curves = [loop(x, 0.0 if number == "K0" else 1.5)[1] for x in variants]
    for curve in (curves[0], curves[2]):
        assert np.abs(curve - curves[1]).max() > 0.03 * np.ptp(curves[1])


def test_the_papers_device_is_the_papers() -> None:
    """Its numbers are those of :mod:`mrwarp.params`; resistance and mass, which it does not state, are not known."""
    model = mrwarp.load_model(PAPER)
    values = MrParams().to_dict()
    assert all(p.value == values[name] for name, p in model.parameters.items())
    assert set(model.not_known) == {"coil resistance", "mass"}
    assert model.to_params().bouc_wen == MrParams().bouc_wen


def test_a_name_stands_for_its_file_and_a_file_goes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of that name, such as the recording itself, does not hide the device."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "emps").mkdir()
    assert model_path("emps") == DEVICES / "emps" / "model.json" and load_model("emps").units["torque"] == "N"
    shutil.copy(DEVICES / PAPER / "model.json", tmp_path / "mr_utfsm")
    assert load_model("mr_utfsm").units["torque"] == "N·m"


def test_list_and_show_print_every_device(capsys: pytest.CaptureFixture) -> None:
    """``list`` has a line for each, ``show`` its numbers with their intervals."""
    assert main(["device", "list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()[1:]] == list(device_names())
    assert main(["device", "show", "emps"]) == 0
    said = capsys.readouterr().out
    assert "rotor_inertia.inertia [kg]" in said and "Apache-2.0" in said and "mrwarp diagnose emps" in said


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the virtual bench, and what ``fit --law`` made of it."""
    from mrwarp.bench.bench_effects import Effects
    from mrwarp.bench.virtual_bench import BenchCfg, run_bench
    from mrwarp.recording.write import save_recording

    folder = tmp_path_factory.mktemp("device")
    effects = Effects.defaults(0.0).replace(torque_noise=0.02)
    cfg = BenchCfg(trajectories=6, samples=6000, evaluation_samples=0, seed=5, effects=effects)
    save_recording(run_bench(cfg).fit, folder / "data")
    assert (
        main(
            [
                "fit",
                str(folder / "data"),
                "--law",
                "dahl",
                "--predict",
                str(folder / "data"),
                "--out",
                str(folder / "fit"),
            ]
        )
        == 0
    )
    return folder


def _stated(folder: Path) -> Path:
    stated = dict.fromkeys(("title", "kind", "origin", "address", "licence", "recorded", "columns"), "a text")
    (folder / "new").mkdir(parents=True)
    (folder / "new" / "device.json").write_text(json.dumps({"stated": stated}))
    return folder


def test_an_entry_is_made_from_a_fit(made: Path, tmp_path: Path) -> None:
    """Numbers come from the results; what people stated stays as it is; a second time gives the same."""
    where, words = _stated(tmp_path / "library"), ["device", "make", "new", "--data", str(made / "data")]
    words += ["--results", str(made / "fit"), "--library", str(where), "--pictures", str(tmp_path / "pictures")]
    assert main(words) == 0
    device = load_device("new", where)
    result = json.loads((made / "fit" / "result.json").read_text())
    assert device.stated["title"] == "a text" and device.joint and device.law == "Dahl's law"
    assert device.measured["held_out"]["nrmse"] == result["held_out_nrmse"]
    assert device.measured["range"]["trajectories"] == 6
    (said,) = device.measured["predicted"]
    assert all(run in said for run in result["predicted"]["Dahl's law"])
    assert f"{100 * result['held_out_nrmse']:.1f} % of the torque, " in device.measured["unexplained"]
    assert device.measured["commands"][0] == result["command"]
    assert 0 < (tmp_path / "pictures" / "new.png").stat().st_size < LARGEST_PICTURE


def test_a_first_answer_makes_no_entry(made: Path, tmp_path: Path) -> None:
    """A diagnosis that was stopped is refused as not final, even next to the model of an earlier one."""
    where, results = _stated(tmp_path / "library"), tmp_path / "results"
    shutil.copytree(made / "fit", results)
    nothing = {"rmse": None, "nrmse": None}
    (results / "result.json").write_text(json.dumps({"final": False, "baseline": nothing, "extended": nothing}))
    with pytest.raises(ValueError, match=r"not final.*let 'mrwarp diagnose' come to its end"):
        make_device("new", where, results, load_recording(made / "data"))


def test_another_recording_or_missing_words_make_no_entry(made: Path, tmp_path: Path) -> None:
    """Nothing is written then."""
    where, data = _stated(tmp_path / "library"), load_recording(made / "data")
    with pytest.raises(RecordingError, match="name that recording"):
        make_device("new", where, made / "fit", load_recording(next((made / "data").glob("*.csv*"))))
    with pytest.raises(JsonFileError, match="write its part 'stated' first"):
        make_device("other", where, made / "fit", data)
    (where / "new" / "device.json").write_text('{"stated": {"title": "a text"}}')
    with pytest.raises(JsonFileError, match="kind"):
        make_device("new", where, made / "fit", data)
    assert device_names(where) == ()
