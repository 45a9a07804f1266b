"""The command line: what it prints and writes, its exit statuses, and one line for everything that goes wrong."""

import importlib
import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from poise.cli import COMMANDS, run
from poise.commands.run import help_of, with_installed_parameters
from poise.recording import JointStream, PoseStream, RecordingWriter, WrenchStream, open_recording, write_recording

ROOT = Path(__file__).resolve().parents[1]
STATIC = str(ROOT / "bags" / "kuka_static_poses.mcap")
CONTRACT = ("mass", "com", "inertia", "covariance", "bias", "delay", "method", "consistent", "n_samples", "rejected")


def strictly(text: str):
    """Parse JSON as the standard has it: no NaN, no Infinity."""

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


def command(*arguments, stdout=subprocess.PIPE, **environment) -> subprocess.CompletedProcess:
    """Run `poise` as a process of its own."""
    call = [sys.executable, "-m", "poise.cli", *arguments]
    given = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run(call, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=60, cwd=ROOT, env=given)


@pytest.fixture
def fails(capsys):
    """Run, and return the exit status with the one line on stderr."""

    def attempt(*arguments):
        status = run(list(arguments))
        printed = capsys.readouterr()
        lines = printed.err.strip().splitlines()
        assert len(lines) == 1, printed.err
        assert lines[0].startswith("poise: ")
        assert printed.out == ""
        return status, lines[0]

    return attempt


# -- what it writes ----------------------------------------------------------------------------------------------


def test_json_has_the_fields_of_the_contract_and_null_for_what_was_not_seen(tmp_path, capsys):
    target = tmp_path / "payload.json"
    assert run(["identify", STATIC, "--method", "static", "--json", str(target)]) == 0
    content = strictly(target.read_text())
    assert set(CONTRACT) <= set(content)
    assert content["mass"] == pytest.approx(0.9323, abs=0.005)
    assert content["com"][2] == pytest.approx(0.0439, abs=0.001)
    assert content["inertia"] == [None] * 6
    covariance = content["covariance"]
    assert (len(covariance), len(covariance[0])) == (10, 10)
    assert covariance[0][0] > 0
    assert covariance[9] == [None] * 10
    assert len(content["bias"]) == 6
    assert content["delay"] is None
    assert content["condition_number"] is None
    assert content["consistent"] is True
    assert content["rejected"] == []
    assert content["losses"] == []
    assert "0.9323" in capsys.readouterr().out


def test_with_json_to_stdout_nothing_else_is_there(capsys):
    assert run(["identify", STATIC, "--json", "-"]) == 0
    printed = capsys.readouterr()
    assert strictly(printed.out)["n_samples"] == 24
    assert "0.9323" in printed.err


def test_rejected_spans_are_told_in_seconds_with_reasons(capsys):
    assert run(["identify", str(ROOT / "bags" / "kuka_free_motion.mcap"), "--method", "ols", "--json", "-"]) == 0
    printed = capsys.readouterr()
    content = strictly(printed.out)
    assert content["rejected"]
    for span in content["rejected"]:
        assert span["start"] <= span["end"]
        assert span["reason"] == "no_kinematics"
        assert 1.7e9 < span["start"] < 1.71e9
    assert any("no positions" in warning for warning in content["warnings"])
    assert "poise: warning: " in printed.err


def test_a_truncated_bag_is_weighed_from_what_is_left_and_the_loss_is_told(tmp_path, capsys):
    whole = (ROOT / "bags" / "kuka_free_motion.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(0.7 * len(whole))])
    assert run(["identify", str(cut), "--method", "ols", "--json", "-"]) == 0
    printed = capsys.readouterr()
    content = strictly(printed.out)
    assert content["losses"][0]["kind"] == "truncated"
    assert content["losses"][0]["sentence"] in content["warnings"][0]
    assert "warning: " in printed.err
    assert 0 < content["n_samples"] < 4224


def test_options_reach_the_estimator(capsys):
    assert run(["identify", STATIC, "--gravity", "9.80665", "--max-force", "18", "--json", "-"]) == 0
    content = strictly(capsys.readouterr().out)
    assert {span["reason"] for span in content["rejected"]} == {"saturated"}
    assert content["n_samples"] < 24


def test_a_report_is_written_and_its_files_are_named(tmp_path, capsys):
    assert run(["identify", STATIC, "--report", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert (tmp_path / "out" / "identification.html").stat().st_size > 10_000
    assert str(tmp_path / "out" / "identification.html") in printed.out


def test_without_rerun_the_html_is_written_and_the_missing_package_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert run(["identify", STATIC, "--report", str(tmp_path)]) == 0
    assert "pip install" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["identification.html"]


def test_evaluate_weighs_every_bag_and_one_that_fails_does_not_stop_the_others(tmp_path, capsys):
    target = tmp_path / "all.json"
    assert run(["evaluate", str(ROOT / "bags"), "--json", str(target)]) == 2
    results = {Path(entry["bag"]).name: entry for entry in strictly(target.read_text())["recordings"]}
    assert results["kuka_static_poses.mcap"]["mass"] == pytest.approx(0.9323, abs=0.005)
    assert results["kuka_at_rest.mcap"]["error"]["name"] == "TOPIC_MISSING"
    assert set(results) == {bag.name for bag in (ROOT / "bags").glob("*.mcap")}
    assert "0.9323" in capsys.readouterr().out


def test_version_and_help_and_an_example_in_it(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("poise ")
    assert run(["identify", "--help"]) == 0
    assert "Example:" in capsys.readouterr().out


HEAVY = ("numpy", "scipy", "pinocchio", "coal", "matplotlib", "rosbags", "trimesh", "yaml", "rerun", "rclpy")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["--show-completion", "bash"], ["run", "--help"]])
def test_the_list_of_commands_is_shown_without_the_numerical_libraries(arguments):
    script = (
        "import sys, poise.cli\n"
        "try: poise.cli.run(sys.argv[1:])\n"
        f"finally: print('loaded:', *(name for name in {HEAVY} if name in sys.modules))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    assert ended.stdout.splitlines()[-1] == "loaded:", ended.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_listed_with_the_first_line_of_its_own_help(name, capsys):
    function = getattr(importlib.import_module(f"poise.commands.{COMMANDS[name][0]}"), name)
    assert function.__doc__.splitlines()[0] == COMMANDS[name][1]
    assert run([name, "--help"]) == 0
    assert "Example:" in capsys.readouterr().out


@pytest.mark.parametrize(("words", "expected"), [("poise se", "segment"), ("poise segment --sca", "--scale")])
def test_the_shell_completes_commands_and_options(words, expected):
    last = str(len(words.split()) - 1)
    ended = command(_POISE_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=last)
    assert expected in ended.stdout.split()


def test_run_lists_the_nodes_and_finds_installed_parameter_files(fails, tmp_path):
    status, line = fails("run", "coffee_machine")
    assert status == 2
    assert "coffee_machine" in line
    assert "inertial_estimator" in line
    (tmp_path / "here.yaml").touch()
    given = ["--ros-args", "--params-file", "here.yaml", "--params-file", "other.yaml", "-r", "here.yaml"]
    expected = ["--ros-args", "--params-file", str(tmp_path / "here.yaml"), *given[3:]]
    assert with_installed_parameters(given, tmp_path) == expected


@pytest.mark.parametrize(("name", "same"), [("ft_driver", "poise run ft_driver --ros-args"), ("loop", "poise loop")])
def test_a_launch_file_is_answered_with_the_command_that_starts_the_same(fails, name, same):
    status, line = fails("run", f"{name}.launch.py", "robot:=fr3")
    assert status == 2
    assert f"`{same}" in line


def test_the_help_of_a_node_does_not_start_it(tmp_path):
    (tmp_path / "ft_driver.yaml").touch()
    entry = EntryPoint("ft_driver", "poise.errors:main", "console_scripts")
    text = help_of(entry, tmp_path)
    assert "poise run ft_driver --ros-args" in text
    assert str(tmp_path / "ft_driver.yaml") in text


# -- what goes wrong ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["identify", "nowhere.mcap"], "nowhere.mcap"),
        (["identify", STATIC, "--method", "magic"], "magic"),
        (["identify", STATIC, "--gravity", "-1"], "gravity"),
        (["identify", STATIC, "--gravity", "nan"], "gravity"),
        (["identify", STATIC, "--gravity", "inf"], "gravity"),
        (["identify", STATIC, "--max-force", "0"], "force"),
        (["identify", STATIC, "--sensor-frame", "hand"], "hand"),
        (["identify", STATIC, "--wrench-topic", "ft"], "ft"),
        (["identify", STATIC, "--urdf", "nowhere.urdf"], "nowhere.urdf"),
        (["identify", STATIC, "--urdf", "fr3"], "joint_states"),
        (["identify", STATIC, "--json", "/"], "folder"),
        (["identify", STATIC, "--json", "/nowhere/\0/x"], "nowhere"),
        (["identify", STATIC, "--gravity", "heavy"], "--gravity"),
        (["identify", STATIC, "--nonsense"], "--nonsense"),
        (["identify", STATIC, "again"], "again"),
        (["identify"], "BAG"),
        (["dance"], "dance"),
        (["evaluate", "nowhere"], "nowhere"),
        (["evaluate", "nowhere/*.mcap"], "nowhere"),
    ],
)
def test_bad_input_is_one_line_that_names_it_and_status_2(fails, arguments, named):
    status, line = fails(*arguments)
    assert status == 2
    assert named in line


def test_a_file_that_is_no_bag_an_empty_one_and_a_folder_are_refused(fails, tmp_path):
    text = tmp_path / "notes.mcap"
    text.write_text("hello")
    empty = tmp_path / "empty.mcap"
    empty.touch()
    folder = tmp_path / "folder"
    folder.mkdir()
    for path in (text, empty, folder):
        status, line = fails("identify", str(path))
        assert status == 2
        assert path.name in line
    assert fails("evaluate", str(folder))[0] == 2


def test_a_broken_urdf_is_named(fails, tmp_path):
    for name, text in [
        ("cut.urdf", "<robot"),
        ("empty.urdf", ""),
        ("frameless.urdf", '<robot name="a"><link name="b"/></robot>'),
    ]:
        (tmp_path / name).write_text(text)
        status, line = fails("identify", STATIC, "--urdf", str(tmp_path / name))
        assert status == 2
        assert name in line


def test_of_a_broken_robot_description_the_bag_is_named(fails, tmp_path):
    stamps = np.arange(0, 10**9, 10**7)
    wrench = WrenchStream(stamps, np.zeros((100, 6)), "ft_sensor")
    joints = JointStream(stamps, ("a",), np.zeros((100, 1)), np.zeros((100, 1)), np.zeros((100, 1)))
    streams = {"wrench": wrench, "joint_states": joints}
    write_recording(tmp_path / "cut_description.mcap", streams, robot_description="<robot")
    status, line = fails("identify", str(tmp_path / "cut_description.mcap"))
    assert status == 2
    assert "cut_description.mcap" in line


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_no_permission_is_said_so(fails, tmp_path):
    locked = tmp_path / "locked.mcap"
    locked.write_bytes(Path(STATIC).read_bytes())
    locked.chmod(0)
    assert fails("identify", str(locked))[0] == 2


def test_time_running_backwards_is_one_line_and_status_2(fails, tmp_path):
    # Two recordings in one, the second with an older clock.
    bag = tmp_path / "back.mcap"
    stamps = np.arange(0, 10**9, 10**7)
    poses = PoseStream(stamps, np.tile(np.eye(3), (100, 1, 1)), np.zeros((100, 3)), "base", "ft_sensor")
    write_recording(bag, {"wrench": WrenchStream(stamps, np.zeros((100, 6)), "ft_sensor"), "tf": poses})
    messages = list(open_recording(bag).messages())
    with RecordingWriter(tmp_path / "jump.mcap") as writer:
        writer.add_topic("wrench", "geometry_msgs/msg/WrenchStamped")
        writer.add_topic("tf", "tf2_msgs/msg/TFMessage")
        for turn in range(2):
            for message in messages:
                writer.write(message.topic, message.log_time + turn * 10**10, message.data)
    status, line = fails("identify", str(tmp_path / "jump.mcap"))
    assert status == 2
    assert "back" in line


def test_one_attitude_has_no_answer_and_status_3(fails, tmp_path):
    stamps = np.arange(0, 2 * 10**9, 10**7)
    poses = PoseStream(stamps, np.tile(np.eye(3), (200, 1, 1)), np.ones((200, 3)), "base", "ft_sensor")
    noise = np.random.default_rng(0).normal(size=(200, 6))
    write_recording(tmp_path / "one.mcap", {"wrench": WrenchStream(stamps, noise, "ft_sensor"), "tf": poses})
    status, line = fails("identify", str(tmp_path / "one.mcap"))
    assert status == 3
    assert "attitudes" in line


def test_what_cannot_be_written_is_said_and_nothing_is_left_half_written(fails, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    for option in ("--json", "--report"):
        status, line = fails("identify", STATIC, option, str(blocked / "inside"))
        assert status == 2
        assert "file" in line
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no /dev/full here")
def test_a_full_disk_is_one_line_and_status_2():
    with Path("/dev/full").open("w") as full:
        for arguments in (["--json", "-"], []):
            ended = command("identify", STATIC, *arguments, stdout=full)
            assert ended.returncode == 2
            assert "space" in ended.stderr.splitlines()[0]
            assert "Traceback" not in ended.stderr
    ended = command("identify", STATIC, "--json", "/dev/full")
    assert ended.returncode == 2
    assert Path("/dev/full").is_char_device()


def test_an_internal_error_is_status_1_and_only_debug_shows_the_traceback(monkeypatch, capsys):
    def broken(*_, **__):
        raise ZeroDivisionError("by mistake")

    monkeypatch.setattr("poise.commands.identify.open_recording", broken)
    assert run(["identify", STATIC]) == 1
    printed = capsys.readouterr().err
    assert "internal error" in printed
    assert "Traceback" not in printed
    for arguments in (["--debug", "identify", STATIC], ["identify", STATIC, "--debug"]):
        assert run(arguments) == 1
        assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv("POISE_DEBUG", "1")
    assert run(["identify", STATIC]) == 1
    assert "by mistake" in capsys.readouterr().err


def test_ctrl_c_ends_without_a_traceback(monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("poise.commands.identify.open_recording", interrupted)
    assert run(["identify", STATIC]) == 130
    assert capsys.readouterr().err == ""


def test_the_command_works_on_a_terminal_without_unicode():
    ended = command("identify", STATIC, PYTHONIOENCODING="ascii", LC_ALL="C")
    assert ended.returncode == 0
    assert "0.9323" in ended.stdout


def test_a_reader_that_leaves_early_gets_no_traceback():
    ended = subprocess.run(
        f"{sys.executable} -m poise.cli identify {STATIC} --json - 2>/dev/null | head -1",
        shell=True,
        capture_output=True,
        text=True,
        timeout=60,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert ended.stdout == "{\n"
    assert ended.stderr == ""


@pytest.mark.parametrize("module", ["poise.cli", "poise.nodes"])
def test_one_thread_multiplies_matrices_unless_the_user_wants_more(module):
    """Threads of OpenBLAS that wait for each other made `poise mismatch` use five times the CPU."""
    code = f"""if True:
        import contextlib, importlib, os, sys
        module = importlib.import_module("{module}")
        with contextlib.suppress(SystemExit):
            sys.argv = ["poise", "--version"]
            getattr(module, "main", lambda: None)()
        assert "numpy" not in sys.modules, "too late for the variable"
        print(os.environ["OPENBLAS_NUM_THREADS"])
    """
    for given, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")):
        clean = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
        done = subprocess.run([sys.executable, "-c", code], env=clean | given, capture_output=True, text=True)
        assert done.stdout.split()[-1] == expected, done.stderr
