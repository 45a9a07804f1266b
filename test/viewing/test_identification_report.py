"""The HTML report: its numbers are the estimate's, it stands alone, nothing from outside runs in it."""

import hashlib
import json
import re
import resource
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from swinging_payload import identify_motion, swing, with_estimate

from poise.errors import ErrorCode, InputError
from poise.inertia.pipeline.estimate import Identification, RejectedInterval
from poise.inertia.pipeline.identification import identify
from poise.recording import open_recording
from poise.viewing.report import _MAX_INTERVALS, write_identification_report

ROOT = Path(__file__).resolve().parents[2]
NOW = datetime(2024, 2, 25, 10, 18, 23, tzinfo=UTC)
HOSTILE = (
    "</title></style></script><script>alert(1)</script><img src=x onerror=alert(2)>\"' onload='x {{7*7}} \0\x1b\u202e"
)
VOID = {"meta", "img", "link", "br", "hr", "input"}


class Page(HTMLParser):
    """What a browser makes of a page: its elements, their text by tag, and whether all are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data))

    def text(self, *tags: str) -> str:
        """All text, or that of some tags."""
        return "".join(data for tag, data in self.texts if tag not in ("style", "script") and (not tags or tag in tags))

    def data(self) -> dict[str, object]:
        """The estimate at full precision."""
        return next(json.loads(data) for tag, data in self.texts if tag == "script" and data.startswith("{"))


def write(folder: Path, identification: Identification, title: str = "Payload", source: str = "run.mcap") -> str:
    path = write_identification_report(folder, identification, title, source, command="poise identify", now=NOW)
    return path.read_bytes().decode("utf-8")


def test_the_numbers_in_the_report_are_the_identifications(tmp_path: Path, identification: Identification) -> None:
    estimate = identification.estimate
    data = Page(write(tmp_path, identification)).data()
    assert data["mass"] == estimate.parameters.mass
    assert data["com"] == estimate.parameters.com.tolist()
    assert data["inertia"] == estimate.parameters.inertia_vector.tolist()
    assert data["covariance"] == estimate.covariance.tolist()
    assert data["bias"] == estimate.bias.tolist()
    assert data["n_samples"] == estimate.n_samples


def test_the_headline_is_mass_and_centre_of_mass_with_their_uncertainty(
    tmp_path: Path, identification: Identification
) -> None:
    headline = " ".join(Page(write(tmp_path, identification)).text("span", "p", "code").split())
    found = re.search(r"([\d.]+) kg ± ([\d.]+) kg ?centre of mass \(([^)]*)\) mm ± \(([^)]*)\) mm", headline)
    assert found
    estimate = identification.estimate
    assert abs(float(found[1]) - estimate.parameters.mass) <= 0.051 * estimate.mass_std
    assert abs(float(found[2]) - estimate.mass_std) <= 0.051 * estimate.mass_std
    com = np.array([float(number) for number in found[3].split(",")])
    assert np.all(np.abs(com / 1e3 - estimate.parameters.com) <= 0.051 * estimate.com_std)
    assert np.allclose([float(number) for number in found[4].split(",")], 1e3 * estimate.com_std, rtol=0.051)


def test_the_report_of_the_real_recording_weighs_its_payload(tmp_path: Path) -> None:
    bag = ROOT / "bags" / "kuka_static_poses.mcap"
    page = Page(write(tmp_path, identify(open_recording(bag), method="static"), source=str(bag)))
    assert "0.9323 kg" in page.text("span").replace("\xa0", " ")
    assert page.text("td").count("not identifiable from this motion") == 6
    assert hashlib.sha256(bag.read_bytes()).hexdigest() in page.text("dd")


def test_what_the_motion_cannot_show_is_said_with_its_reason(
    tmp_path: Path, static_identification: Identification
) -> None:
    text = write(tmp_path, static_identification)
    page = Page(text)
    assert page.text("td").count("not identifiable from this motion") == 6
    assert "rotational inertia shows only about axes whose turning speeds up" in page.text()
    assert page.data()["inertia"] == [None] * 6
    assert not re.search(r"\bnan\b", re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL), re.IGNORECASE)


def test_an_unknown_mass_is_the_headline_too(tmp_path: Path, identification: Identification) -> None:
    names = ("m", "cx", "cy", "cz")
    covariance = identification.estimate.covariance.copy()
    covariance[:4] = covariance[:, :4] = np.nan
    page = Page(write(tmp_path, with_estimate(identification, unidentified=names, covariance=covariance)))
    assert "Mass not identifiable from this motion" in page.text("span")
    assert "it tilted by at most" in page.text()


def test_the_report_needs_nothing_from_elsewhere(tmp_path: Path, identification: Identification) -> None:
    text = write(tmp_path, identification)
    assert "http" not in text.replace("http-equiv", "")
    assert "@import" not in text
    assert set(re.findall(r"url\((.)", text)) <= {"#"}
    for tag, attributes in Page(text).elements:
        assert tag not in ("link", "img", "iframe", "object", "embed", "base", "form")
        assert not {"src", "srcset", "action", "data"} & set(attributes)
        assert (attributes.get("href") or "#").startswith("#")


def test_the_page_forbids_itself_the_network_and_every_script_but_its_own(
    tmp_path: Path, identification: Identification
) -> None:
    page = Page(write(tmp_path, identification))
    policy = next(at["content"] for tag, at in page.elements if at.get("http-equiv") == "Content-Security-Policy")
    assert re.fullmatch(r"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-[\w+/]{43}='", policy or "")
    assert not [name for _, attributes in page.elements for name in attributes if name.startswith("on")]


def test_hostile_names_are_shown_and_never_run(tmp_path: Path, identification: Identification) -> None:
    rejected = (RejectedInterval(*_span(identification), 3, HOSTILE),)
    hostile = with_estimate(identification, frame_id=HOSTILE, method=HOSTILE, rejected=rejected)
    text = write(tmp_path, hostile, title=HOSTILE, source=HOSTILE)
    page = Page(text)
    assert not page.open
    assert [tag for tag, _ in page.elements].count("script") == 2
    assert not [name for _, attributes in page.elements for name in attributes if name.startswith("on")]
    assert "img" not in [tag for tag, _ in page.elements]
    assert not set("\0\x1b\u202e") & set(text)
    assert "<script>alert(1)</script>" in page.text("h1")
    assert "{{7*7}}" in page.text("h1")
    assert "alert(1)" in str(page.data()["frame_id"])


def test_endless_names_do_not_make_an_endless_report(tmp_path: Path, identification: Identification) -> None:
    plain = write(tmp_path, identification)
    long = "A" * 1_000_000
    many = tuple(RejectedInterval(*_span(identification), 1, long) for _ in range(2000))
    text = write(
        tmp_path, with_estimate(identification, frame_id=long, method=long, rejected=many), title=long, source=long
    )
    assert len(text) < len(plain) + 1_500_000
    assert f"… and {2000 - _MAX_INTERVALS} more intervals." in text


def test_the_same_input_gives_the_same_bytes(tmp_path: Path, identification: Identification) -> None:
    assert write(tmp_path / "a", identification) == write(tmp_path / "b", identification)


def test_the_page_is_well_formed_and_every_id_is_unique(tmp_path: Path, identification: Identification) -> None:
    page = Page(write(tmp_path, identification))
    assert not page.open
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    used = [attributes["clip-path"] for _, attributes in page.elements if "clip-path" in attributes]
    assert used
    assert {str(name)[5:-1] for name in used} <= set(ids)


def test_every_picture_says_in_words_what_it_shows(tmp_path: Path, identification: Identification) -> None:
    pictures = [attributes for tag, attributes in Page(write(tmp_path, identification)).elements if tag == "svg"]
    assert len(pictures) == 6 + 6 + 10 + 6
    for attributes in pictures:
        assert attributes["role"] == "img"
        assert len(attributes["aria-label"] or "") > 20


def test_five_thousand_samples_fit_three_megabytes(tmp_path: Path) -> None:
    assert len(write(tmp_path, identify_motion(swing(5000)))) < 3_000_000


def test_rejected_samples_are_marked_and_listed(tmp_path: Path, identification: Identification) -> None:
    text = write(tmp_path, identification)
    interval = identification.estimate.rejected[0]
    origin = int(identification.stamps[0])
    row = [f"{(stamp - origin) * 1e-9:.3f}" for stamp in (interval.start, interval.end)]
    row += [str(interval.n_samples), "saturated"]
    assert re.search(r"<tr>" + r"\s*".join(rf"<td[^>]*>{re.escape(cell)}</td>" for cell in row), text)
    shaded = [figure for figure in re.findall(r"<figure.*?</figure>", text, re.DOTALL) if "var(--rejected)" in figure]
    assert len(shaded) == 6 + 6 + 5


def test_the_recordings_hash_is_that_of_its_bytes(tmp_path: Path, identification: Identification) -> None:
    recording = tmp_path / "run.mcap"
    recording.write_bytes(b"abc")
    text = write(tmp_path, identification, source=str(recording))
    assert "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" in text  # FIPS 180-2, appendix B.1
    assert "2024-02-25 10:18:23 UTC" in text


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_handful_of_samples_still_makes_a_report(
    tmp_path: Path, static_identification: Identification, samples: int
) -> None:
    few = replace(
        static_identification,
        stamps=static_identification.stamps[:samples],
        wrench_measured=static_identification.wrench_measured[:samples],
        wrench_predicted=static_identification.wrench_predicted[:samples],
        motion=static_identification.motion.select(slice(samples)),
        history=(),
    )
    page = Page(write(tmp_path, few))
    assert "Convergence of the estimate" not in page.text("h2")
    assert not page.open


def test_samples_that_are_not_finite_do_not_stop_the_report(tmp_path: Path, identification: Identification) -> None:
    measured = identification.wrench_measured.copy()
    measured[10:20, 2] = np.nan
    assert not Page(write(tmp_path, replace(identification, wrench_measured=measured))).open


def test_a_full_disk_leaves_the_earlier_report_and_nothing_else(tmp_path: Path, identification: Identification) -> None:
    before = write(tmp_path, identification)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(InputError) as caught:
            write(tmp_path, identification, title="Another")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.code == ErrorCode.FILE_UNWRITABLE
    assert str(tmp_path) in caught.value.message
    assert [path.name for path in tmp_path.iterdir()] == ["identification.html"]
    assert (tmp_path / "identification.html").read_text(encoding="utf-8") == before


def test_a_file_in_place_of_the_folder_is_named(tmp_path: Path, identification: Identification) -> None:
    (tmp_path / "report").write_text("mine")
    with pytest.raises(InputError) as caught:
        write(tmp_path / "report", identification)
    assert caught.value.code == ErrorCode.FILE_UNWRITABLE
    assert (tmp_path / "report").read_text() == "mine"


def test_a_folder_name_with_a_nul_is_bad_input(tmp_path: Path, identification: Identification) -> None:
    with pytest.raises(InputError):
        write(tmp_path / "a\0b", identification)


def _span(identification: Identification) -> tuple[int, int]:
    return int(identification.stamps[5]), int(identification.stamps[8])
