"""What the command line answers to who asks for help, mistypes, or wants little or machine text."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import imapper_prob
from imapper_prob.cli import main
from imapper_prob.cli.console import print_lines
from imapper_prob.cli.main import command_parser
from imapper_prob.cli.parser import commands_of
from imapper_prob.results.load import load_posterior
from tests.conftest import ROOT
from tests.test_structure import HEAVY

COMMANDS = list(commands_of(command_parser()))
LEAVES = [(name, p) for name, p in COMMANDS if not any(n[:-1] == name for n, _ in COMMANDS)]


def ended(arguments: list[str]) -> int:
    """The status with which a command ends, whichever way."""
    try:
        return main(arguments)
    except SystemExit as end:
        return int(end.code or 0)


@pytest.mark.parametrize("words", [[], ["scenelets"]])
def test_without_arguments_there_is_help(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(words) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "examples:" in told.out
    assert f"usage: {' '.join(['imapper-prob', *words])} " in told.out


@pytest.mark.parametrize(("name", "parser"), COMMANDS, ids=[" ".join(n) for n, _ in COMMANDS])
def test_every_option_is_explained(name: tuple[str, ...], parser) -> None:
    told = parser.format_help()
    assert f"  imapper-prob {name[0]}" in told.split("examples:")[1]
    for action in parser._actions:
        assert action.help or not action.option_strings, action.option_strings
        silent = action.nargs == 0 or action.required or not action.option_strings
        if not silent and action.default is None:
            said = "(default" in action.help or "such as" in action.help
            assert said, f"{name} {action.option_strings}: no default is named"


def test_examples_are_commands() -> None:
    """What help shows can be typed."""
    for _, parser in COMMANDS:
        for line in parser.format_help().split("examples:")[1].strip().splitlines():
            words = line.split(">")[0].split()
            assert words[0] == "imapper-prob"
            if "--help" not in words:
                command_parser().parse_args(words[1:])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rnu"], "did you mean run?"),
        (["run", "clip", "--step", "3"], "there is no option --step; did you mean --steps?"),
        (["run", "--sede", "3"], "did you mean --seed?"),
        (["demo", "-o", "d", "--until", "godo"], "'godo' is none of good; did you mean good?"),
        (["run", "clip", "more", "-o", "d"], "2 clips: takes of one room need --same-room"),
        (["demo", "more", "-o", "d"], "nothing is expected at more"),
        (["run", "clip"], "required: -o/--output"),
        (["--debug", "run"], "there is no option --debug"),
        (["scenelets", "inof"], "did you mean info?"),
    ],
)
def test_mistypes_are_answered_on_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(words) == 2
    told = capsys.readouterr()
    assert said in told.err
    assert told.err.count("\n") == 1
    assert told.out == ""


def test_the_version_has_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(["--version"]) == 0
    assert capsys.readouterr().out == f"imapper-prob {imapper_prob.__version__}\n"


def test_a_file_of_a_run_stands_for_its_folder(
    run_of_demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(run_of_demo, run)
    assert main(["info", str(run / "posterior.nc")]) == 0
    by_file = capsys.readouterr().out
    assert main(["info", str(run)]) == 0
    assert by_file == capsys.readouterr().out
    assert load_posterior(run / "posterior.nc").clip.name == load_posterior(run).clip.name
    glb = tmp_path / "scene.glb"
    assert main(["export", str(run / "posterior.nc"), "--format", "glb", "-o", str(glb)]) == 0
    assert glb.stat().st_size > 0


def test_a_table_has_the_numbers_of_the_report(
    run_of_demo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(run_of_demo)]) == 0
    told = capsys.readouterr().out
    report = (run_of_demo / "report.html").read_text(encoding="utf-8")
    places = re.findall(r"-?\d+\.\d\d ± \d\.\d\d", told.split("Objects")[1].split("Checks")[0])
    assert places
    for place in places:
        assert f">{place}<" in report


def test_json_is_one_document_and_nothing_else(
    run_of_demo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(run_of_demo), "--json"]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert told.err == ""
    assert found["run"]["good"] is False
    assert found["run"]["folder"] == str(run_of_demo)
    assert found["scenes"][0]["probability"] >= found["scenes"][1]["probability"]
    posterior = load_posterior(run_of_demo)
    assert [o["label"] for o in found["objects"]] == posterior.summary()["label"].values.tolist()


def test_quiet_says_nothing_but_errors(
    run_of_demo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(run_of_demo), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["info", "nowhere", "--quiet"]) == 2
    assert "nowhere" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("imapper-prob ex", {"export"}),
        ("imapper-prob run --st", {"--steps"}),
        ("imapper-prob run --preset p", {"paper"}),
        ("imapper-prob scenelets b", {"build"}),
        ("imapper-prob scenelets build --le", {"--leave-out"}),
    ],
)
def test_bash_completes(typed: str, offered: set[str], capsys: pytest.CaptureFixture[str]) -> None:
    if shutil.which("bash") is None:
        pytest.skip("there is no bash")
    assert main(["completion", "bash"]) == 0
    words = typed.split()
    asked = (
        f"{capsys.readouterr().out}\nCOMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}\n"
        '_imapper_prob; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", asked], capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) == offered


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name[-1] in script for name, _ in COMMANDS)
    program = shutil.which(shell)
    if program is not None:
        subprocess.run([program, "-n"], input=script, text=True, check=True)


def test_help_loads_nothing_heavy() -> None:
    program = "import sys, imapper_prob.cli.main; sys.stdout.write(' '.join(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) & HEAVY == set()


def test_what_the_system_refuses_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "locked.npz"
    path.write_bytes(b"PK")
    files = Path.open

    def locked(self: Path, *arguments: object, **more: object) -> object:
        if self == path:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        return files(self, *arguments, **more)

    monkeypatch.setattr(Path, "open", locked)
    for name in (str(path), "n" * 300):
        assert main(["info", name]) == 2
        told = capsys.readouterr().err
        assert told.startswith(f"imapper-prob: {name}: cannot be read or written (")
        assert told.count("\n") == 1
    with pytest.raises(PermissionError):
        main(["info", str(path), "--debug"])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device here")
def test_a_full_disk_behind_the_output_is_one_line() -> None:
    command = [sys.executable, "-m", "imapper_prob.cli", "completion", "bash"]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert ended.returncode == 2
    assert "No space left" in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "word"),
    [(["--fps", "10"], "fps"), (["--size", "3x3"], "size"), (["--frames", "1:2"], "frames"),
     (["--camera", "x"], "camera"), (["--tracker", "paper"], "tracker")],
)  # fmt: skip
def test_options_of_clips_are_refused_for_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], word: str
) -> None:
    (tmp_path / "scenes.json").touch()
    assert main(["info", str(tmp_path), *options]) == 2
    assert f"is a run; --{word} is for a clip" in capsys.readouterr().err


def test_info_names_what_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(tmp_path / "nothere.npz")]) == 2
    assert capsys.readouterr().err.endswith("nothere.npz: no such file or folder\n")
    assert main(["info", str(tmp_path)]) == 2
    assert "is neither the folder of a run nor a clip" in capsys.readouterr().err


def test_a_document_is_printed_even_if_quiet(
    run_of_demo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(run_of_demo), "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["run"]["folder"] == str(run_of_demo)
    assert main(["completion", "bash", "--quiet"]) == 0
    assert "complete -o filenames" in capsys.readouterr().out


def test_commands_to_copy_are_whole(capsys: pytest.CaptureFixture[str]) -> None:
    command = f"imapper-prob view '{'a folder ' * 30}'"
    print_lines(command)
    assert capsys.readouterr().out == f"{command}\n"
