"""From recordings to a model, and to what the model lacks. Put the folder of your own in place of ``runs/example``.

Run: ``python examples/fit_and_diagnose.py`` (a minute)
"""

from pathlib import Path

import mrwarp
from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, run_bench
from mrwarp.recording.write import save_recording
from mrwarp.runtime import quiet_libraries

DATA = Path("runs/example/recordings")


def main(data: Path = DATA) -> None:
    """Make example data with a hidden coil lag of 20 ms, fit eq. 14 to it, and ask what is missing."""
    effects = Effects.defaults(0.0).replace(coil_lag=0.02, torque_noise=0.02)
    save_recording(run_bench(BenchCfg(trajectories=8, samples=6000, evaluation_samples=0, effects=effects)).fit, data)

    fitted = mrwarp.fit(data)
    print(f"eq. 14 leaves {100 * fitted.nrmse:.1f} % of the torque")

    found = mrwarp.diagnose(data)
    for cause in found.causes:
        numbers = ", ".join(f"{name} {x.value:.4g} {x.unit}" for name, x in cause.parameters.items())
        print(f"missing: {cause.name}: {numbers}; explains {100 * cause.gain:.0f} % of the mismatch")
    print(f"verdict {found.verdict}; report: {found.report(data.parent / 'report')}")
    mrwarp.save_model(found.model or fitted.model, data.parent / "model.json")


if __name__ == "__main__":
    quiet_libraries(gpu=False, networks=False)
    main()
