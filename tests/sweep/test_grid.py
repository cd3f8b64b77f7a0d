"""Grid of a sweep: the combinations, their arguments and folders, and refusals before anything runs."""

from pathlib import Path

import pytest

from mrwarp.sweep.grid import GridError, Trial, make_trials


def trials_of(command: str, grid: list[str], fixed: list[str], cpus: int = 1) -> list[Trial]:
    """Trials of a sweep into a folder that is not there."""
    return make_trials(command, grid, fixed, Path("nowhere"), threads=cpus)


def test_combinations_in_order() -> None:
    """Two options: all pairs, the last varying fastest, the fixed arguments in front of all."""
    trials = trials_of("train", ["seed=0,1", "actuator=none,bouc_wen"], ["--num-envs", "8"], cpus=2)
    assert [trial.folder.name for trial in trials] == [
        "seed=0_actuator=none",
        "seed=0_actuator=bouc_wen",
        "seed=1_actuator=none",
        "seed=1_actuator=bouc_wen",
    ]
    assert trials[1].args == ["train", "--num-envs", "8", "--threads=2", "--seed=0", "--actuator=bouc_wen"]
    assert trials[1].values == {"seed": "0", "actuator": "bouc_wen"}


def test_values_of_several_words_and_flags() -> None:
    """A quoted list is several values, a negative number no option, a flag is there or not."""
    impact = trials_of("impact", ["current=0 0.5,1.5", "live=on,off"], [])
    assert [trial.args[1:] for trial in impact] == [
        ["--current", "0", "0.5", "--live"], ["--current", "0", "0.5"],
        ["--current=1.5", "--live"], ["--current=1.5"],
    ]  # fmt: skip
    assert impact[0].folder.name == "current=0-0.5_live=on"
    assert trials_of("impact", ["speed=-0.5"], [])[0].args == ["impact", "--speed=-0.5"]


def test_threads_are_the_users_where_given() -> None:
    """The sweep's share of the cores does not override the user's number, and goes to no command without the option."""
    assert "--threads=4" not in trials_of("train", ["seed=0"], ["--threads=1"], cpus=4)[0].args
    assert trials_of("impact", ["seed=0"], [], cpus=4)[0].args == ["impact", "--seed=0"]


REFUSED = {
    "an unknown command": ("dance", ["seed=0"], [], "--command dance: cannot be swept; choose one"),
    "a sweep of sweeps": ("sweep", ["seed=0"], [], "--command sweep: cannot be swept"),
    "a command without figures": ("asset", ["seed=0"], [], "--command asset: cannot be swept"),
    "an unknown option": ("train", ["sed=0"], [], "sed=0: mrwarp train: .*--sed=0; did you mean --seed?"),
    "the output": ("train", ["out=a,b"], [], "--out: the sweep sets it for every trial; leave it out"),
    "no value": ("train", ["seed"], [], "seed: not of the form name=value"),
    "an empty value": ("train", ["seed=0,,1"], [], "seed=0,,1: not of the form"),
    "a value twice": ("train", ["seed=0,0"], [], "two trials would share the folder seed=0; name each value once"),
    "an option twice": ("train", ["seed=0", "seed=1"], [], "--grid seed=1: .* with every name once"),
    "a value the command refuses": ("train", ["actuator=none,magic"], [], "actuator=magic: .*--actuator.*magic"),
    "a number that is none": ("train", ["seed=a"], [], "seed=a: .*--seed"),
    "a fixed argument the command refuses": ("train", ["seed=0"], ["--num-envs", "0"], "--num-envs.*0 must be"),
    "a flag with a value": ("train", ["no-gate=1"], [], "--no-gate is a flag; give no-gate=on,off"),
    "output among the fixed": ("train", ["seed=0"], ["--out", "x"], "--out: the sweep sets it"),
    "an option in both": ("train", ["seed=0"], ["--seed=1"], "--seed after '--': it is in the grid"),
    "names that meet": ("train", ["model=a/b,a-b"], [], "two trials would share the folder model=a-b"),
    "far too many": (
        "train", [f"seed={','.join(map(str, range(200)))}", f"num-envs={','.join(map(str, range(1, 101)))}"], [],
        "20000 combinations are more than 10000",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_refusals(what: str) -> None:
    """One line that names option and value."""
    command, grid, fixed, message = REFUSED[what]
    with pytest.raises(GridError, match=message) as info:
        trials_of(command, grid, fixed)
    assert "\n" not in str(info.value)
