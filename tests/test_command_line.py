"""What a user sees when something is wrong: one clear line and an exit code."""

import pickle
from pathlib import Path

import pytest

from followerd.__main__ import call
from followerd.errors import OpenError
from followerd.resources import shipped


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().err.strip()


def test_an_unknown_command_or_option_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["fly"]) == 2
    assert call(["demo", "--speed", "3"]) == 2
    assert "--speed" in said(capsys)


@pytest.mark.parametrize(
    ("tokens", "complaint"),
    [
        (["demo", "--scenario", "moon", "--virtual"], "no scenario moon; there are "),
        (["demo", "--camera", "9x9@1", "--virtual"], "--camera 9x9@1: there are 192x144@15"),
        (["demo", "--tracker", "none", "--virtual"], "--tracker none: there are head, "),
        (["run", "none.yaml"], "none.yaml: no such file"),
        (["run", "hpf-sim"], "has links that say sim; give --links, or use followerd demo"),
        (["sim", "corridor", "--links", "x", "--fault", "laser"], "expected DEVICE:NAME@START"),
        (["sim", "corridor", "--links", "x", "--fault", "arm:off@1+1"], "no device 'arm'"),
        (["demo", "--duration", "-3"], "Must be > 0"),
        (["demo", "--summary", "/nowhere/s.json"], "/nowhere is no folder"),
        (["ctl", "enrol", "1,2,3"], "ctl enrol takes X,Y or X,Y,W,H"),
        (["ctl", "arm", "1,2"], "takes nothing more than its name"),
    ],
)
def test_wrong_things_get_one_line_and_exit_code_2(
    tokens: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(tokens) == 2
    line = said(capsys)
    assert complaint in line
    assert line.startswith("followerd: ")
    assert "Traceback" not in line


def test_ctl_without_a_daemon_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["ctl", "status", "--socket", str(tmp_path / "none")]) == 3
    assert "nobody listens at" in said(capsys)


def test_a_fault_without_a_simulation_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["fault", str(tmp_path), "laser:off+1s"]) == 3
    assert "simulation: nobody listens at" in (line := said(capsys))
    assert "is `followerd sim` running?" in line


def robot_config(tmp_path: Path, base_link: str) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(
        f"base: {{kind: p2os, link: {base_link}}}\n"
        f"laser: {{kind: lms200, link: {base_link}}}\n"
        f"camera: {{kind: camera, link: {tmp_path / 'ring'}}}\n"
        "tracker: {kind: hpf}\n"
        "controller: {kind: image_centering}\n"
        f"socket: {tmp_path / 'ctl'}\n"
        "log_level: error\n"
    )
    return path


def test_a_port_that_does_not_exist_is_a_device_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = robot_config(tmp_path, "/dev/ttyUSB99")
    assert call(["run", str(config), "--duration", "5"]) == 3
    assert "/dev/ttyUSB99 does not exist" in said(capsys)


def test_a_file_that_is_no_serial_port_is_a_device_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = tmp_path / "plain"
    plain.write_text("")
    assert call(["run", str(robot_config(tmp_path, str(plain))), "--duration", "5"]) == 3
    assert str(plain) in said(capsys)


def test_check_says_what_a_config_sets_up(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["check", "hpf"]) == 0
    out = capsys.readouterr().out
    assert "base: p2os at /dev/ttyUSB0" in out


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        (("kind: camera\n", "kind: thermal\n"), "hpf needs a camera for colour or depth"),
        (("resolution_deg: 1\n", "resolution_deg: 0.5\n"), "too slow to drive by"),
        (("{kind: hpf, profile: default}", "{kind: stream_field}"), "add a localizer section"),
    ],
)
def test_check_knows_what_does_not_go_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: tuple[str, str], complaint: str
) -> None:
    text = shipped("hpf.yaml").read_text()
    assert changed[0] in text
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace(*changed))
    assert call(["check", str(path)]) == 2
    assert complaint in capsys.readouterr().err


def test_check_names_every_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("base: {kind: p2os}\nwheels: 3\n")
    assert call(["check", str(path)]) == 2
    lines = said(capsys).splitlines()
    assert any("bad.yaml:1:1: base.link: is required" in line for line in lines)
    assert any("bad.yaml:2:1: wheels: unknown key" in line for line in lines)


def test_errors_survive_the_way_between_processes() -> None:
    error = OpenError("laser", "is busy", "close the other program")
    back = pickle.loads(pickle.dumps(error))
    assert (str(back), back.device, back.exit_code) == (str(error), "laser", 3)


def test_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["schema"]) == 0
    assert capsys.readouterr().out.lstrip().startswith("{")
