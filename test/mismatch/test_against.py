"""A simulator's recording, several recordings, other names of joints, bags without stamps."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.compare import make_pair
from poise.cli import run
from poise.mismatch.comparing.alignment import look_alikes
from poise.recording import JointStream, open_recording, write_recording


def answer(folder: Path, *words: str) -> dict[str, Any]:
    assert run([*words, "--json", str(folder / "answer.json")]) == 0
    found: dict[str, Any] = json.loads((folder / "answer.json").read_text())
    return found


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A robot with more dry friction in some joints, and what both lack; in `bare` without robot_description."""
    folder = tmp_path_factory.mktemp("pair")
    _, truth = make_pair(7, folder, "frictionloss", "same", seconds=8.0)
    for name in "ab":
        write_recording(folder / f"bare_{name}.mcap", {"joint_states": states(folder, name)})
    return folder, truth


def states(folder: Path, name: str) -> JointStream:
    return open_recording(folder / f"{name}.mcap").joint_states()


def test_without_any_model_the_joints_and_what_the_difference_goes_with_are_found(pair, tmp_path: Path) -> None:
    folder, truth = pair
    real = truth["in"]
    sim = "b" if real == "a" else "a"
    words = ["mismatch", str(folder / f"bare_{real}.mcap"), "--against", str(folder / f"bare_{sim}.mcap")]
    found = answer(tmp_path, *words)
    assert found["verdict"] == "unknown"
    differing = [each for each in found["channels"] if each["differs"]]
    assert 1 <= len(differing) <= 3
    for each in differing:
        assert each["goes_with"][0][0] == "the direction of its motion"
        assert each["goes_with"][0][1] > 0.9
    assert {name for each in found["where"] for name in each["channels"]} == {each["name"] for each in differing}


def test_with_a_description_in_one_of_the_bags_it_is_named_also_in_sim_time(pair, tmp_path: Path) -> None:
    folder, truth = pair
    real = truth["in"]
    sim = states(folder, "b" if real == "a" else "a")
    write_recording(tmp_path / "sim.mcap", {"joint_states": replace(sim, stamps=sim.stamps - sim.stamps[0])})
    words = ["mismatch", str(folder / f"{real}.mcap"), "--against", str(tmp_path / "sim.mcap")]
    found = answer(tmp_path, *words, "--model", str(folder / "model.yaml"))
    assert [each["name"] for each in found["effects"]] == ["coulomb_friction"]
    assert found["effects"][0]["more_in"] == "b"


def test_bags_whose_headers_have_no_stamps_are_read_at_their_log_times(pair, tmp_path: Path, capsys) -> None:
    folder, _ = pair
    without_stamps(folder / "bare_a.mcap", tmp_path / "sim.mcap")
    found = answer(tmp_path, "mismatch", str(folder / "bare_a.mcap"), "--against", str(tmp_path / "sim.mcap"))
    assert found["verdict"] == "none"
    assert "have no stamps" in capsys.readouterr().err


def without_stamps(source: Path, target: Path) -> None:
    """The bag, with the stamp of every header zero; its log times stay."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    with source.open("rb") as read, target.open("wb") as write:
        writer = Writer(write)
        writer.start(profile="ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(read).iter_messages():
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
            data = message.data[:4] + bytes(8) + message.data[12:]  # CDR header, then sec and nanosec
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()


def test_other_motions_are_compared_through_the_model(tmp_path: Path) -> None:
    bags, truth = make_pair(6, tmp_path, "damping", "other", seconds=14.0)
    found = answer(tmp_path, "compare", *bags, "--model", str(tmp_path / "model.yaml"))
    assert [each["name"] for each in found["effects"]] == ["viscous_friction"]
    assert found["effects"][0]["more_in"] == truth["in"]
    assert "through the model" in found["alignment"]["notes"][0]


def test_names_that_look_alike() -> None:
    assert look_alikes(["shoulder_pan", "gripper"], ["shoulder_pan_joint", "wheel"]) == [
        ("shoulder_pan", "shoulder_pan_joint")
    ]
    assert look_alikes(["panda_joint1", "panda_joint2"], ["fr3_joint2", "fr3_joint1"]) == [
        ("panda_joint1", "fr3_joint1"),
        ("panda_joint2", "fr3_joint2"),
    ]
    assert look_alikes(["left_wheel"], ["elbow"]) == []


def test_of_several_recordings_the_answer_says_when_a_change_appeared(pair, tmp_path: Path, capsys) -> None:
    """Their joints have other names: these are refused with those that look alike, and mapped."""
    folder, truth = pair
    more, less = truth["in"], "b" if truth["in"] == "a" else "a"
    before, after = tmp_path / "before", tmp_path / "after"
    own_names = states(folder, "a").names
    other_names = tuple(name.replace("joint", "robot/axis_") for name in own_names)
    described = open_recording(folder / "a.mcap").robot_description()
    for place, name, day in ((before, less, 0), (after, less, 1), (after, more, 2)):
        own, names = states(folder, name), own_names if day == 0 else other_names
        # Noise of its own: equal readings would be one recording.
        effort = own.effort * (1.0 + 1e-9 * day)
        stream = replace(own, stamps=own.stamps + day * 10**14, names=names, effort=effort)
        place.mkdir(exist_ok=True)
        description = described if day == 0 else None
        write_recording(place / f"{day}.mcap", {"joint_states": stream}, robot_description=description)
    words = ["compare", str(before), str(after), "--model", str(folder / "model.yaml")]
    assert run(words) == 2
    said = capsys.readouterr().err
    mapping = ",".join(f"{other}={name}" for other, name in zip(other_names, own_names, strict=True))
    assert f"--joints {mapping}" in said
    assert run([*words, "--joints", f"{mapping},x"]) == 2
    found = answer(tmp_path, *words, "--joints", mapping)
    assert [Path(each["bag"]).name for each in found["recordings"]] == ["1.mcap", "2.mcap"]
    assert [each["verdict"] for each in found["recordings"]] == ["none", "named"]
    (appeared,) = found["appeared"]
    assert (appeared["name"], Path(appeared["first"]).name) == ("coulomb_friction", "2.mcap")
    assert appeared["lasting"]
    assert not appeared["in_before"]


def test_motions_that_never_meet_need_a_model(pair, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, _ = pair
    there = states(folder, "b")
    write_recording(tmp_path / "there.mcap", {"joint_states": replace(there, position=there.position + 1.5)})
    assert run(["mismatch", str(folder / "bare_a.mcap"), "--against", str(tmp_path / "there.mcap")]) == 3
    assert "0% of the recording's motion is also in the simulator's" in " ".join(capsys.readouterr().err.split())
