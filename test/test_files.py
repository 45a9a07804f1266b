"""A file is written whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from poise.errors import ErrorCode, InputError
from poise.files import package_file, write_whole


def test_missing_folders_are_made_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = write_whole(tmp_path / "a" / "b" / "answer.json", b"{}")
    assert path.read_bytes() == b"{}"
    assert [entry.name for entry in path.parent.iterdir()] == ["answer.json"]


def test_the_file_may_be_read_by_whom_the_mask_allows(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        path = write_whole(tmp_path / "answer.json", b"{}")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_folder_in_place_of_the_file_stays_as_it_was(tmp_path: Path) -> None:
    target = tmp_path / "answer.json"
    (target / "inside").mkdir(parents=True)
    with pytest.raises(InputError, match=r"answer\.json") as caught:
        write_whole(target, b"{}")
    assert caught.value.code == ErrorCode.FILE_UNWRITABLE
    assert [entry.name for entry in tmp_path.iterdir()] == ["answer.json"]
    assert (target / "inside").is_dir()


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "\ud800"])
def test_a_name_that_cannot_be_is_bad_input(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        write_whole(tmp_path / name, b"{}")
    assert not list(tmp_path.iterdir())


def test_a_uri_names_a_file_in_the_share_folder_of_an_installed_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share = tmp_path / "share" / "robots"
    share.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert package_file("package://robots/bags/a.mcap") == share / "bags" / "a.mcap"
    assert package_file("bags/a.mcap") == Path("bags/a.mcap")
    for uri, code in (
        ("package://other/a", ErrorCode.FILE_UNREADABLE),
        ("package:///a", ErrorCode.FILE_UNREADABLE),
        ("package://robots/../../a", ErrorCode.UNSUPPORTED),
    ):
        with pytest.raises(InputError) as found:
            package_file(uri)
        assert found.value.code == code
