"""`python evaluate.py`: help that teaches, one clear line for an error, exit status."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import evaluate
from evaluation.policies import policy_names
from evaluation.suites import SUITES

ROOT = Path(__file__).parents[2]


def test_a_small_run_from_the_command_line(tmp_path, capsys):
    status = evaluate.main(
        [
            "--suite",
            "vortex",
            "--policies",
            "drift,direct-flight",
            "--episodes",
            "2",
            "--output",
            str(tmp_path),
        ]
    )
    printed = capsys.readouterr().out
    assert status == 0
    assert "direct-flight" in printed and "index.html" in printed
    assert {path.name for path in tmp_path.iterdir()} == {"index.html", "results.json"}
    content = json.loads((tmp_path / "results.json").read_text())
    assert content["manifest"]["command"].startswith("python evaluate.py --suite vortex")


def test_a_crash_gives_status_1_and_keeps_the_rest(tmp_path, capsys):
    names = "own_policies:Crash,drift"
    assert (
        evaluate.main(
            ["--suite", "vortex", "--policies", names, "--episodes", "2", "--output", str(tmp_path)]
        )
        == 1
    )
    assert "the third decision is too much" in capsys.readouterr().out
    entries = json.loads((tmp_path / "results.json").read_text())["results"]
    assert ["error" in entry for entry in entries] == [True, False]


def test_ctrl_c_writes_what_there_is_and_gives_130(tmp_path, capsys):
    names = "drift,own_policies:Interrupting"
    status = evaluate.main(
        ["--suite", "vortex", "--policies", names, "--episodes", "2", "--output", str(tmp_path)]
    )
    assert status == 130
    assert (tmp_path / "index.html").exists()
    assert [e["policy"] for e in json.loads((tmp_path / "results.json").read_text())["results"]] == ["drift"]


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--suite", "vortx"], "Did you mean 'vortex'"),
        (["--policies", "optimum"], "Did you mean 'optimal'"),
        (["--task", "drifthop"], "Did you mean 'drift-hop'"),
        (["--suite", "file"], "--currents|NetCDF"),
        (["--currents", "nowhere.nc"], "nowhere.nc"),
        (["--episodes", "0"], "episodes: got 0"),
        (["--seed", "100"], "seed: got 100"),
        (["published", "--runs", "0"], "runs: got 0"),
        (["--currents", "evaluate.py", "--suite", "file"], "evaluate.py"),
        (["--suite", "vortex", "--policies", "drift", "--output", "evaluate.py"], "evaluate.py"),
    ],
)
def test_wrong_input_ends_with_status_2_and_one_line(arguments, message, capsys, monkeypatch):
    import re

    monkeypatch.chdir(ROOT)
    assert evaluate.main(arguments) == 2
    printed = capsys.readouterr()
    lines = printed.err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("evaluate.py: ")
    assert re.search(message, lines[0])


def test_an_unknown_option_ends_with_status_2(capsys):
    with pytest.raises(SystemExit) as end:
        evaluate.main(["--epsodes", "3"])
    assert end.value.code == 2
    assert "--episodes" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--help"], ["published", "--help"]])
def test_help_teaches_every_option(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        evaluate.main(arguments)
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert "Example" in text
    options = (
        ("--runs", "--seed", "--output") if "published" in arguments
        else ("--task", "--policies", "--suite", "--episodes", "--seed", "--currents", "--output", "published", "gyres")
    )  # fmt: skip
    for option in options:
        assert option in text


def test_help_names_every_task_policy_and_suite(capsys):
    with pytest.raises(SystemExit):
        evaluate.main(["--help"])
    words = set(re.split(r"[\s│,;:()]+", capsys.readouterr().out))
    families = {"calm", "vortex", "gyres", "omlp-"}
    for task, suites in SUITES.items():
        names = [task, *policy_names(task), *(suite.name for suite in suites)]
        measured = {f"{water}-{kind}" for water in families for kind in ("bearing", "range", "tdoa")}
        assert {name for name in names if name not in measured} <= words


def test_two_files_and_a_center_with_a_negative_longitude_are_understood(tmp_path, capsys):
    u, v = tmp_path / "u.nc", tmp_path / "v.nc"
    for path in (u, v):
        path.write_bytes(b"no netcdf")
    status = evaluate.main(
        ["--suite", "file", "--currents", str(u), str(v), "--currents-center", "36.6", "-122.2"]
    )
    # Understood as far as the files, which are refused by name.
    assert status == 2 and "u.nc" in capsys.readouterr().err


def test_help_needs_no_heavy_import():
    code = "import sys, evaluate\ntry:\n    evaluate.main(['--help'])\nexcept SystemExit:\n    pass\n" + (
        "print(sorted({'numba', 'matplotlib', 'torch', 'xarray'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "matplotlib" not in done.stdout.splitlines()[-1] and "torch" not in done.stdout.splitlines()[-1]
