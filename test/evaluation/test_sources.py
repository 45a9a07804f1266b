"""Sources of an evaluation: folders, globs and URLs give each file once, in the order of names."""

import zipfile
from pathlib import Path

import pytest

from poise.commands.evaluate import groups_of, labels
from poise.errors import ErrorCode, InputError
from poise.evaluation import JOBS, RECORDINGS, DataSource, find_sources

SCENES = JOBS["robustness"].kind


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Two robots with two recordings each, one of them a folder of rosbag2, and other files."""
    for robot in ("robot_1", "robot_2"):
        (tmp_path / robot / "split").mkdir(parents=True)
        (tmp_path / robot / "a.mcap").write_text(robot)
        (tmp_path / robot / "split" / "split_0.mcap").write_text(robot)
        (tmp_path / robot / "split" / "metadata.yaml").write_text("x")
        (tmp_path / robot / "a.truth.yaml").write_text("mass: 1.0")
        (tmp_path / robot / "notes.txt").write_text("x")
    return tmp_path


def names(folder: Path, *patterns: str) -> list[str]:
    found, _ = find_sources([str(folder / pattern) for pattern in patterns], RECORDINGS)
    return [str(Path(source.name).relative_to(folder)) for source in found]


def test_a_folder_gives_its_recordings_and_names_what_is_none(fleet: Path) -> None:
    found, skipped = find_sources([str(fleet / "robot_1")], RECORDINGS)
    assert [Path(source.name).name for source in found] == ["a.mcap", "split"]
    assert "notes.txt" in skipped


def test_a_glob_gives_each_recording_once_and_not_the_parts_of_a_folder(fleet: Path) -> None:
    wanted = ["robot_1/a.mcap", "robot_1/split", "robot_2/a.mcap", "robot_2/split"]
    assert names(fleet, "**") == wanted
    assert names(fleet, "robot_*/*", "robot_1", "robot_1/a.mcap") == wanted


def test_truth_files_are_no_scenes(tmp_path: Path) -> None:
    for name in ("tray.yaml", "tray.truth.yaml"):
        (tmp_path / name).touch()
    found, _ = find_sources([str(tmp_path)], SCENES)
    assert [Path(source.name).name for source in found] == ["tray.yaml"]


@pytest.mark.parametrize(
    ("pattern", "code", "named"),
    [
        ("nowhere", ErrorCode.FILE_UNREADABLE, "nowhere does not exist"),
        ("nowhere/*.mcap", ErrorCode.EMPTY, "no recording"),
        ("gopher://host/bags", ErrorCode.FILE_UNREADABLE, "gopher"),
        ("file:///nowhere/x.mcap", ErrorCode.FILE_UNREADABLE, "/nowhere/x.mcap"),
    ],
)
def test_what_is_not_there_is_refused(pattern: str, code: ErrorCode, named: str) -> None:
    with pytest.raises(InputError) as caught:
        find_sources([pattern], RECORDINGS)
    assert caught.value.code is code
    assert named in caught.value.message


def test_urls_give_files_folders_globs_and_members_of_an_archive(fleet: Path) -> None:
    for url, count in (("robot_1", 2), ("robot_*/*.mcap", 2), ("robot_1/a.mcap", 1), ("robot_2/split", 1)):
        found, _ = find_sources([f"file://{fleet}/{url}"], RECORDINGS)
        assert len(found) == count, url
        assert all(source.name.startswith("file://") for source in found)
        assert all(source.size for source in found if source.name.endswith("a.mcap"))
    with zipfile.ZipFile(fleet / "fleet.zip", "w") as archive:
        archive.write(fleet / "robot_1" / "a.mcap", "bags/a.mcap")
    found, _ = find_sources([f"zip://bags/*.mcap::file://{fleet}/fleet.zip"], RECORDINGS)
    assert [source.name for source in found] == [f"zip://bags/a.mcap::file://{fleet}/fleet.zip"]


def test_sources_are_grouped_by_folder_or_by_an_expression() -> None:
    sources = [DataSource(f"/data/{robot}/2026/run_{robot}.mcap") for robot in ("ur_1", "ur_2")]
    assert set(groups_of(sources, None).values()) == {"2026"}
    assert list(groups_of(sources, r"/(ur_\d)/").values()) == ["ur_1", "ur_2"]
    for pattern in ("(", "ur"):
        with pytest.raises(InputError, match="--group"):
            groups_of(sources, pattern)


def test_labels_of_sources_differ_and_fit_into_file_names() -> None:
    sources = [DataSource(name) for name in ("/data/a/run.mcap", "/data/b/run.mcap", "/data/b/x y.mcap")]
    assert list(labels(sources).values()) == ["a_run", "b_run", "b_x_y"]
    assert list(labels(sources[:1]).values()) == ["run"]
