"""Runs notebooks without Jupyter: their cells in order, with what they print and draw as their outputs.

``python -m tests.examples.notebooks`` writes the outputs into the files. Jupyter's runner would add a kernel, ZeroMQ
and a dozen more packages; these notebooks hold plain Python, and pictures of matplotlib.
"""

import base64
import contextlib
import io
import json
from pathlib import Path
from typing import Any

import matplotlib

from mrwarp.runtime import quiet_libraries

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "notebooks"


def executed(path: Path) -> dict[str, Any]:
    """The notebook with the outputs of its cells; an error of a cell is raised."""
    matplotlib.use("Agg")
    quiet_libraries()  # Warp prints the folder of its cache
    from matplotlib import pyplot

    notebook, names = json.loads(path.read_text(encoding="utf-8")), {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, 1):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile("".join(cell["source"]), f"{path.name}, cell {count}", "exec"), names)
        outputs: list[dict[str, Any]] = []
        if said.getvalue():
            outputs.append(
                {"name": "stdout", "output_type": "stream", "text": said.getvalue().splitlines(keepends=True)}
            )
        for number in pyplot.get_fignums():
            drawn = io.BytesIO()
            pyplot.figure(number).savefig(drawn, format="png", dpi=70)
            picture = {"image/png": base64.b64encode(drawn.getvalue()).decode()}
            outputs.append({"data": picture, "metadata": {}, "output_type": "display_data"})
        pyplot.close("all")
        cell |= {"execution_count": count, "outputs": outputs}
    return notebook


if __name__ == "__main__":
    for file in sorted(FOLDER.glob("*.ipynb")):
        file.write_text(json.dumps(executed(file), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{file.name}: executed")
