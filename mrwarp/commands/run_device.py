"""``mrwarp device``: the library of identified devices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Positional

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.resources import DEVICES
from mrwarp.run_dir import check_output, check_writable, write_text
from mrwarp.runtime import drawing, quiet_libraries, text_table

Name = Positional[Annotated[str, opt.one(str, "NAME")]]


@dataclass(frozen=True, kw_only=True)
class ListDevices(Options):
    """List the identified devices; every --model takes their names."""

    engines: ClassVar[bool] = False

    def run(self, line: CommandLine) -> int:
        """0."""
        from mrwarp.devices.entry import library, overview

        head, rows = overview(library())
        print("\n".join(text_table(head, rows, left=len(head))))
        return 0


@dataclass(frozen=True, kw_only=True)
class ShowDevice(Options):
    """Show a device: law and numbers with intervals, range, errors, what is unexplained, source, commands."""

    engines: ClassVar[bool] = False
    name: Name
    """device of 'mrwarp device list'"""
    png: opt.OptionalFile = None
    """save a picture: the loop with less and more of each number of eqs. 14, 15 and 18"""

    def run(self, line: CommandLine) -> int:
        """0 when it is shown, 2 when there is none of this name."""
        from mrwarp.devices.entry import lines, load_device, numbers

        check_output(self.png, ".png")

        device = load_device(self.name)
        table = text_table(("number", "value", "95 % interval"), numbers(device.model))
        print("\n".join([*lines(device), "", *table]))
        if self.png:
            quiet_libraries(gpu=False, networks=False)
            from mrwarp.devices.number_picture import number_picture

            print(f"\npicture: {number_picture(device.model, self.png, self.name)}")
        return 0


@dataclass(frozen=True, kw_only=True)
class MakeDevice(Options):
    """Make an entry of the library out of the results of 'mrwarp fit' or 'mrwarp diagnose', in a checkout.

    What people state of the device is in NAME/device.json already, see CONTRIBUTING.md.
    """

    engines: ClassVar[bool] = False
    name: Name
    """name of the device; 'paper' needs no recording"""
    data: opt.OptionalFile = None
    """recording that the results were made of"""
    results: opt.OptionalFolder = None
    """output folder of 'mrwarp fit' or 'mrwarp diagnose'"""
    library: opt.Folder = DEVICES
    """folder of the library"""
    pictures: opt.OptionalFolder = None
    """folder for the picture (default: docs/images/devices of the checkout)"""

    def run(self, line: CommandLine) -> int:
        """0 when it is written, 2 on bad input: then nothing is."""
        from mrwarp.devices.device_page import PICTURES, ROOT
        from mrwarp.devices.entry import lines
        from mrwarp.devices.make_entry import PAPER, make_device, make_paper_device
        from mrwarp.recording.load import load_recording

        pictures = self.pictures or ROOT / PICTURES
        check_writable(self.library)
        check_writable(pictures)
        if self.name != PAPER and (self.data is None or self.results is None):
            raise ValueError("--data and --results: name the recording, and what 'mrwarp fit' or 'diagnose' made of it")
        quiet_libraries(gpu=False, networks=False)
        from mrwarp.devices.loop_picture import loop_picture, paper_motion

        if self.data is None or self.results is None:
            device = make_paper_device(self.library)
            recording = paper_motion(device)
        else:
            recording = load_recording(self.data)
            device = make_device(self.name, self.library, self.results, recording)
        print("\n".join(lines(device)))
        with drawing(f"{self.name}.png"):
            path = loop_picture(device, recording, pictures / f"{self.name}.png", measured=self.data is not None)
            print(f"\n{self.library / self.name} written; picture: {path}")
        return 0


@dataclass(frozen=True, kw_only=True)
class ExportDevice(Options):
    """Write a device for other hosts: NAME.h for C, NAME.py with NumPy alone, NAME_mujoco.h and .xml for plain MuJoCo.

    They are the kernels' own laws with every effect that acts, and give the same torque to rounding.
    """

    networks: ClassVar[bool] = False
    model: Positional[Annotated[str, opt.one(str, "MODEL")]]
    """model.json of 'mrwarp fit', or a device of 'mrwarp device list'"""
    out: opt.Folder = Path("runs/export")
    """output folder"""
    dt: Annotated[float, opt.one(opt.positive, "S")] = 0.001
    """control period of the host [s]"""
    name: Annotated[str, opt.one(str, "NAME")] = "mr_joint"
    """front of files, functions and constants"""

    def run(self, line: CommandLine) -> int:
        """0 when all is written, 2 where the device cannot be exported: then nothing is."""
        from mrwarp.export.writers import export_device
        from mrwarp.model_file import load_model

        for path in export_device(load_model(self.model), self.out, dt=self.dt, name=self.name).values():
            print(path)
        return 0


@dataclass(frozen=True, kw_only=True)
class DevicePage(Options):
    """Write docs/devices.md and docs/devices from the library, and the numbers of docs/joint.md, in a checkout."""

    engines: ClassVar[bool] = False
    only_check: opt.Flag = False
    """write nothing; exit code 1 where a page differs, or a picture is missing"""

    def run(self, line: CommandLine) -> int:
        """0 written or equal, 1 when it differs under ``--only-check``, 2 outside of a checkout."""
        from mrwarp.devices.device_page import EQUATIONS, FOLDER, PAGE, PICTURES, ROOT, pages_of, with_numbers
        from mrwarp.resources import device_names

        if not (ROOT / "docs").is_dir():
            raise ValueError(f"{ROOT}: has no docs; run it in a checkout")
        texts = {ROOT / path: text for path, text in pages_of(DEVICES).items()}
        equations = ROOT / EQUATIONS
        texts[equations] = with_numbers(equations.read_text("utf-8"))
        missing = [name for name in device_names() if not (ROOT / PICTURES / f"{name}.png").is_file()]
        for name in missing:
            print(f"{PICTURES / name}.png: missing; run mrwarp device make {name}")
        stale = [path for path in sorted((ROOT / FOLDER).glob("*.md")) if path not in texts]
        if not self.only_check:
            for path in stale:
                path.unlink()
            for path, text in texts.items():
                write_text(path, text)
            print(f"{PAGE}, {len(texts) - 2} pages in {FOLDER} and the numbers of {EQUATIONS}: written")
            return 0
        differing = [path for path, text in texts.items() if not path.is_file() or path.read_text("utf-8") != text]
        for path in [*differing, *stale]:
            print(f"{path.relative_to(ROOT)}: differs; run mrwarp device page")
        return 1 if differing or stale or missing else 0
