"""The Rerun recording, read back: the same numbers, the same motion, the layout, nothing half-written."""

import resource
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from scipy.spatial.transform import Rotation
from swinging_payload import TRUTH, with_estimate

from poise.errors import ErrorCode, InputError
from poise.inertia.pipeline.estimate import Identification, RejectedInterval
from poise.viewing.rerun_scene import _CHANNELS, _METRES_PER_NEWTON, _PATHS, write_identification_recording
from poise.viewing.summary import com_covariance, shown_parameters, shown_sigmas

rrd = pytest.importorskip("rerun.chunk", reason="rerun-sdk is an extra")

SCALES = np.array([1.0] + [1e3] * 9)


class Recording:
    """An .rrd file, entity by entity."""

    def __init__(self, path: Path) -> None:
        self.reader = rrd.RrdReader(str(path))
        chunks = self.reader.stream().to_chunks()
        self.rows = {
            chunk.entity_path: pa.record_batch(chunk.to_record_batch()) for chunk in chunks if not chunk.is_static
        }
        self.static = {chunk.entity_path for chunk in chunks if chunk.is_static}

    def values(self, entity: str, component: str) -> np.ndarray:
        """(N, ...) a component with one instance per row."""
        batch = self.rows[entity]
        column = batch.column(next(i for i, name in enumerate(batch.schema.names) if name.endswith(component)))
        return np.array([row[0] for row in column.to_pylist()])

    def stamps(self, entity: str) -> np.ndarray:
        """(N,) int64 ns."""
        batch = self.rows[entity]
        return batch.column(batch.schema.names.index("stamp")).cast(pa.int64()).to_numpy()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, identification: Identification) -> Recording:
    return Recording(write_identification_recording(tmp_path_factory.mktemp("rrd") / "run.rrd", identification))


def test_the_wrench_in_the_recording_is_the_identifications(
    recording: Recording, identification: Identification
) -> None:
    measured, predicted = identification.wrench_measured, identification.wrench_predicted
    for channel, name in enumerate(_CHANNELS):
        assert np.array_equal(recording.values(f"/wrench/{name}/measured", ":scalars"), measured[:, channel])
        assert np.array_equal(recording.values(f"/wrench/{name}/predicted", ":scalars"), predicted[:, channel])
        left_over = recording.values(f"/residual/{name}", ":scalars")
        assert np.array_equal(left_over, measured[:, channel] - predicted[:, channel])
        assert np.array_equal(recording.stamps(f"/residual/{name}"), identification.stamps)


def test_the_estimate_closes_in_between_its_two_sigma_bounds(
    recording: Recording, identification: Identification
) -> None:
    values = np.array([shown_parameters(estimate) for estimate in identification.history]) * SCALES
    sigmas = np.array([shown_sigmas(estimate) for estimate in identification.history]) * SCALES
    for index, name in enumerate(_PATHS):
        low, value, high = (
            recording.values(f"/estimate/{name}/{part}", ":scalars") for part in ("low", "value", "high")
        )
        known = np.isfinite(values[:, index])  # the first few samples do not show everything
        assert np.allclose(value, values[known, index], rtol=1e-15)
        assert np.allclose(high - low, 4 * sigmas[known, index])
        assert high[-1] - low[-1] < high[0] - low[0]


def test_the_sensor_turns_as_it_did(recording: Recording, identification: Identification) -> None:
    turned = Rotation.from_quat(recording.values("/world/sensor", ":quaternion")).as_matrix()
    assert np.allclose(turned, identification.motion.rotation_world_sensor, atol=1e-6)  # Rerun keeps single precision
    assert np.array_equal(recording.stamps("/world/sensor"), identification.motion.stamps)


def test_the_force_arrow_is_the_load_without_the_bias(recording: Recording, identification: Identification) -> None:
    force = identification.wrench_measured[:, :3] - identification.estimate.bias[:3]
    arrows = recording.values("/world/sensor/force", ":vectors")
    assert np.allclose(arrows, _METRES_PER_NEWTON * force, atol=1e-6)
    assert "/world/gravity" in recording.static


def test_the_ellipsoid_is_two_sigma_about_the_centre_of_mass(
    recording: Recording, identification: Identification
) -> None:
    entity = "/world/sensor/com_uncertainty"
    half_axes = recording.values(entity, ":half_sizes")[-1]
    axes = Rotation.from_quat(recording.values(entity, ":quaternions")[-1]).as_matrix()
    covariance = com_covariance(identification.estimate)
    assert np.allclose(
        axes @ np.diag((half_axes / 2) ** 2) @ axes.T, covariance, rtol=1e-4, atol=1e-5 * covariance.max()
    )
    assert np.allclose(recording.values(entity, ":centers")[-1], identification.estimate.parameters.com, atol=1e-6)
    assert np.allclose(recording.values("/world/sensor/com", ":positions")[-1], TRUTH.com, atol=1e-3)


def test_rejected_intervals_are_in_the_log_at_their_start(recording: Recording, identification: Identification) -> None:
    interval = identification.estimate.rejected[0]
    assert recording.stamps("/log").tolist() == [interval.start]
    assert "saturated" in str(recording.values("/log", ":text")[0])


def test_the_recording_brings_its_own_layout(recording: Recording) -> None:
    assert len(recording.reader.recordings()) == 1
    assert len(recording.reader.blueprints()) == 1
    assert "/summary" in recording.static


def test_what_the_motion_cannot_show_is_left_out(tmp_path: Path, static_identification: Identification) -> None:
    rows = Recording(write_identification_recording(tmp_path / "static.rrd", static_identification)).rows
    assert "/estimate/mass/value" in rows
    assert "/estimate/inertia_xx/value" not in rows
    assert "/world/sensor/payload" not in rows


def test_a_recording_with_one_estimate_and_hostile_names_opens(tmp_path: Path, identification: Identification) -> None:
    rejected = (
        RejectedInterval(int(identification.stamps[3]), int(identification.stamps[4]), 2, "\0</x>\udcff" * 1000),
    )
    hostile = with_estimate(identification, rejected=rejected, frame_id="\0![](file)" * 10_000, method="\udc80")
    hostile = type(hostile)(**{**vars(hostile), "history": ()})
    rows = Recording(write_identification_recording(tmp_path / "hostile.rrd", hostile)).rows
    assert rows["/estimate/mass/value"].num_rows == 1
    assert rows["/log"].num_rows == 1


def test_without_rerun_the_error_names_the_line_that_installs_it(
    tmp_path: Path, identification: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"pip install 'poise\[viewer\]'") as caught:
        write_identification_recording(tmp_path / "run.rrd", identification)
    assert caught.value.code == ErrorCode.UNSUPPORTED
    assert not list(tmp_path.iterdir())


def test_a_full_disk_leaves_no_recording(tmp_path: Path, identification: Identification) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        with pytest.raises(InputError) as caught:
            write_identification_recording(tmp_path / "run.rrd", identification)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.code == ErrorCode.FILE_UNWRITABLE
    assert not list(tmp_path.iterdir())
