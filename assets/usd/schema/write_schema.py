"""Write ``generatedSchema.usda`` next to this file from ``mrwarp/params.py``: run after a change of the parameters."""

from pathlib import Path

from mrwarp.params import MrParams
from mrwarp.usd.open_stage import SCHEMA
from mrwarp.usd.record import PREFIX

TARGET = Path(__file__).resolve().parent / "generatedSchema.usda"

HEAD = f'''#usda 1.0
(
    doc = "Written by assets/usd/schema/write_schema.py from mrwarp/params.py; do not edit."
)

class "{SCHEMA}" (
    apiSchemas = ["NewtonActuatorControlBaseAPI"]
    doc = """Magnetorheological device and electric motor on one joint: current-aware Bouc-Wen torque, holding law,
    gates, motor gains and coil. Applies to NewtonActuator prims. Angles in radians."""
)
{{
'''

ATTRIBUTE = '''    double {prefix}{spec.name} = {spec.default!r} (
        doc = """{spec.doc}

        Unit: {spec.unit}
        Range: [{spec.low:g}, {spec.high:g}]
        Source: {spec.source}"""
        limits = {{
            dictionary hard = {{
                double maximum = {spec.high!r}
                double minimum = {spec.low!r}
            }}
        }}
    )
'''


def schema_text() -> str:
    """The schema as USD text, one attribute per parameter in the order of ``MrParams.specs()``."""
    return HEAD + "\n".join(ATTRIBUTE.format(prefix=PREFIX, spec=spec) for spec in MrParams.specs()) + "}\n"


if __name__ == "__main__":
    TARGET.write_text(schema_text(), encoding="utf-8")
    print(f"wrote {TARGET}")
