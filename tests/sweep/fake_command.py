"""Stands in for ``mrwarp train`` where a sweep is tested: a counter with checkpoints, and misfortunes by seed.

Seed 90 refuses its input, 91 crashes, 92 kills itself in its first life, 93 misses its aim.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

STEPS = 20
BAD, CRASHING, KILLED, MISSED = 90, 91, 92, 93

argv = sys.argv[1:]
out = Path(argv[argv.index("--out") + 1])
seed = next(int(word.partition("=")[2]) for word in argv if word.startswith("--seed="))
step_time = float(os.environ.get("FAKE_STEP_TIME", "0.02"))
checkpoint = out / "checkpoint.pt"
step = int(checkpoint.read_text()) if "--resume" in argv else 0
print(f"starts at step {step}", flush=True)
signal.signal(signal.SIGINT, lambda *_: sys.exit(130))
if seed == BAD:
    print("train/ppo.py: seed 90 is refused", file=sys.stderr)
    sys.exit(2)
while step < STEPS:
    time.sleep(step_time)
    step += 1
    partial = checkpoint.with_suffix(".part")
    partial.write_text(str(step))
    partial.replace(checkpoint)
    if step >= STEPS // 2 and seed == CRASHING:
        raise RuntimeError("seed 91 crashes")
    if step == STEPS // 2 and seed == KILLED and "--resume" not in argv:
        os.kill(os.getpid(), signal.SIGKILL)
(out / "result.json").write_text(
    json.dumps({"gate_passed": seed != MISSED, "gate": {"v_x_rmse": {"0.5": 0.1 + 0.01 * seed}}, "iterations": step})
)
sys.exit(int(seed == MISSED))
