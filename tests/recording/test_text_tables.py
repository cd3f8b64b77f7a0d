"""Files as people have them: other separators, headers, slower channels, MATLAB, numpy and spreadsheets."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mrwarp import cli
from mrwarp.recording.load import RecordingError, load_recording
from mrwarp.recording.records import records_of
from mrwarp.recording.tables import KINDS
from mrwarp.recording.text_tables import read_head
from tests.messages import Refused
from tests.recording.recordings import columns

NAMES = "t,q,qd,current,torque"


def _rows(separator: str = ",", count: int = 200) -> str:
    table = np.column_stack(list(columns(count).values()))
    return "\n".join(separator.join(f"{x:.9g}" for x in row) for row in table) + "\n"


TEXTS = {
    "spaces": NAMES.replace(",", " ") + "\n" + _rows(" "),
    "aligned": "   ".join(f"{x:>8s}" for x in NAMES.split(",")) + "\n" + _rows("    "),
    "tabulators": NAMES.replace(",", "\t") + "\n" + _rows("\t"),
    "decimal commas": NAMES.replace(",", ";") + "\n" + _rows(";").replace(".", ","),
    "decimal commas, tabulators": NAMES.replace(",", "\t") + "\n" + _rows("\t").replace(".", ","),
    "numpy's header": "# " + NAMES.replace(",", " ") + "\n" + _rows(" "),
    "MATLAB's header": "% bench: 4\n% " + NAMES + "\n" + _rows(),
    "words before": "Bench 4\nOperator X\n\n" + NAMES + "\n" + _rows(),
    "ends of lines": (NAMES + "\n" + _rows()).replace("\n", "\r\n"),
    "separators at ends": (NAMES + "\n" + _rows()).replace("\n", ",\n"),
}


@pytest.mark.parametrize("name", ["a.csv", "a.txt", "a.dat"])
@pytest.mark.parametrize("case", list(TEXTS))
def test_tables_of_other_programs_are_read(tmp_path: Path, case: str, name: str) -> None:
    """Equal numbers, however they are separated; a note next to them is no recording."""
    (tmp_path / name).write_text(TEXTS[case], newline="")
    (tmp_path / "README.txt").write_text("Bench 4, recorded on day 3.\n1 2 3\n")
    (run,) = load_recording(tmp_path).trajectories
    for key, x in columns().items():
        np.testing.assert_allclose(getattr(run, key), x, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_folder_takes_what_a_file_may_be(tmp_path: Path, kind: str) -> None:
    """One list of endings: no recording is overlooked, whichever it has."""
    path = tmp_path / f"a{kind}"
    path.write_bytes(b"t q\n1 2 3\n1 2 3\n1 2 3\n")
    with pytest.raises(RecordingError, match=re.escape(str(path))):
        load_recording(path)
    with pytest.raises(RecordingError, match=re.escape(str(path))):
        load_recording(tmp_path)
    assert records_of(tmp_path) == [path]


def test_texts_with_decimal_commas_blanks_and_names_are_found_in_a_folder(tmp_path: Path) -> None:
    """A torque in every second row, and a column of names, leave a table one; a note alone is refused as none."""
    (tmp_path / "README.txt").write_text("Bench 4, recorded on day 3\nt, q, current, torque\n1, 2, 3\n")
    with pytest.raises(RecordingError, match=r"\.csv, .*\.txt.* files\); no rows of numbers .* README\.txt"):
        load_recording(tmp_path)
    rows = [[f"{x:.4f}".replace(".", ",") for x in row] for row in np.column_stack(list(columns().values()))]
    blanks = [[*row[:-1], "" if k % 2 else row[-1]] for k, row in enumerate(rows)]
    named = [[*row, "up"] for row in rows]
    for name, table, more in (("a.txt", blanks, ""), ("b.dat", named, ",trajectory")):
        lines = [*(NAMES + more).split(",")], *table
        (tmp_path / name).write_text("Bench 4\n" + "".join("\t".join(line) + "\n" for line in lines))
    assert [run.id for run in load_recording(tmp_path).trajectories] == ["a", "b/up"]


@pytest.mark.parametrize(
    "names",
    [
        "time,pos (5),vel (5),cur (5),torque (5)",
        "time [s],pos [rad],vel [rad/s],i [A],tau [Nm]",
        "a,b,c,d,e",
        "T,Q,QD,I,TAU",
    ],
)
def test_the_line_that_names_the_columns_can_be_copied(tmp_path: Path, names: str) -> None:
    """The refusal declares which column is which; with it the file is read as it stands."""
    path = tmp_path / "a.csv"
    path.write_text(names + "\n" + _rows())
    with pytest.raises(RecordingError, match="in units.json") as refused:
        load_recording(path)
    at = str(refused.value).index('{"columns"')
    declared, _ = json.JSONDecoder().raw_decode(str(refused.value)[at:])
    (tmp_path / "units.json").write_text(json.dumps(declared))
    np.testing.assert_allclose(load_recording(path).trajectories[0].torque, columns()["torque"], rtol=1e-8, atol=1e-9)


def test_a_map_stands_in_place_of_units_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    """``--map`` names columns and units; one that is not there is refused."""
    (tmp_path / "a.csv").write_text("zeit,phi,w,x,m\n" + _rows())
    names = {"t": "zeit", "q": "phi", "qd": "w", "current": "x", "torque": "m"}
    (tmp_path / "own.json").write_text(json.dumps({"columns": names, "torque": "N·cm"}))
    assert cli.main(["check", str(tmp_path / "a.csv"), "--map", str(tmp_path / "own.json")]) == 0
    assert "torque        -0.009963 to 0.009963" in capsys.readouterr().out
    (tmp_path / "own.json").write_text(json.dumps({"columns": {**names, "torque": "n"}}))
    said = refused("check", tmp_path / "a.csv", "--map", tmp_path / "own.json")
    assert "column 'n', declared as 'torque', is missing" in said


@pytest.mark.parametrize(("name", "every"), [("torque", 4), ("current", 5), ("q", 2), ("qd", 3)])
def test_a_slower_channel_goes_on_between_its_values(tmp_path: Path, name: str, every: int) -> None:
    """Blank cells between them: a command is held, all else joined, and a note says so. Single blanks are refused."""
    data = columns(400)
    lines = [[f"{x:.9g}" for x in row] for row in np.column_stack(list(data.values()))]
    for k, line in enumerate(lines):
        line[list(data).index(name)] = line[list(data).index(name)] if k % every == 0 else ""
    (tmp_path / "a.csv").write_text(NAMES + "\n" + "\n".join(map(",".join, lines)) + "\n")
    recording = load_recording(tmp_path)
    x = getattr(recording.trajectories[0], name)
    np.testing.assert_allclose(x[::every][:-1], data[name][::every][:-1], rtol=1e-7, atol=1e-8)
    assert "as a slower channel" in recording.repaired()[0]
    if name == "current":
        assert set(x) == {0.0, 1.0}


def test_containers_are_read_or_list_what_they_hold(tmp_path: Path) -> None:
    """MATLAB's older and newer files, numpy's without pickles, a sheet with a title; runs may stand side by side."""
    scipy_io, h5py, openpyxl = (pytest.importorskip(x) for x in ("scipy.io", "h5py", "openpyxl"))
    data = columns()
    scipy_io.savemat(tmp_path / "a.mat", {**data, "coil_resistance": 3.0})
    np.savez(tmp_path / "b.npz", **data)
    with h5py.File(tmp_path / "c.mat", "w") as file:
        for key, x in data.items():
            file[key] = x[None, :]
    book = openpyxl.Workbook()
    book.active.append(["Bench 4"])
    for row in [list(data), *np.column_stack(list(data.values())).tolist()]:
        book.active.append(row)
    book.save(tmp_path / "d.xlsx")
    recording = load_recording(tmp_path)
    assert [run.id for run in recording.trajectories] == ["a", "b", "c", "d"]
    for run in recording.trajectories:
        np.testing.assert_allclose(run.torque, data["torque"], rtol=1e-12)
    assert recording.trajectories[0].header["coil_resistance"] == 3.0
    other = tmp_path / "other"
    other.mkdir()
    scipy_io.savemat(other / "a.mat", {"log": {"x": np.column_stack([data[k] for k in ("t", "q", "qd", "torque")])}})
    with pytest.raises(RecordingError, match=r"log.x 200 x 4") as refused:
        load_recording(other)
    declared, _ = json.JSONDecoder().raw_decode(str(refused.value)[str(refused.value).index('{"columns"') :])
    assert declared["columns"]["torque"] == "log.x[:,3]" and declared["current"] == "none"
    (other / "units.json").write_text(json.dumps(declared))
    np.testing.assert_allclose(load_recording(other).trajectories[0].q, data["q"])
    side = {"t": data["t"], **{k: np.column_stack([x, x]) for k, x in data.items() if k != "t"}}
    np.savez(tmp_path / "other" / "b.npz", **side)
    (other / "units.json").unlink()
    assert len(load_recording(other / "b.npz").trajectories) == 2
    np.savez(other / "c.npz", t=np.array([1, "x"], dtype=object))
    with pytest.raises(RecordingError, match="no readable|not a readable .npz"):
        load_recording(other / "c.npz")


def test_a_log_at_a_megahertz_is_averaged_while_it_is_read(tmp_path: Path) -> None:
    """Means of a hundred rows, at 10 kHz: what is held of a text is a few times its length at most."""
    count = 250_000
    t = np.arange(count) * 1e-6
    q = 0.5 * np.sin(2.0 * np.pi * 20.0 * t)
    with (tmp_path / "a.csv").open("w") as file:
        file.write("t,q,current,torque\n")
        for first in range(0, count, 125_000):
            part = slice(first, first + 125_000)
            np.savetxt(file, np.column_stack([t, q, 0.0 * q, np.sin(9.0 * q)])[part], fmt="%.9f", delimiter=",")
    size = (tmp_path / "a.csv").stat().st_size
    code = (
        "import resource, sys\nfrom mrwarp.recording.load import load_recording\nuse = lambda: resource.getrusage("
        "resource.RUSAGE_SELF).ru_maxrss\nbefore = use()\nrun, = load_recording(sys.argv[1]).trajectories\n"
        "print(run.dt, use() - before)"
    )
    out = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True).stdout
    dt, kilobytes = map(float, out.split())
    assert dt == pytest.approx(1e-4, rel=1e-6)
    assert 1024.0 * kilobytes < 4.0 * size
    (run,) = load_recording(tmp_path).trajectories
    np.testing.assert_allclose(run.q, 0.5 * np.sin(2.0 * np.pi * 20.0 * run.t), atol=1e-5)


def test_a_header_s_words_are_no_names() -> None:
    """A line of the header with a colon is an entry, unless names stand behind it."""
    table, _ = read_head(
        b"# date: 2026\n# columns: t q torque\n0 1 2\n1 2 3\n2 3 4\n", lambda x: x in ("t", "q", "torque")
    )
    assert table.header == {"date": 2026} and table.names == ["t", "q", "torque"] and table.separator is None
