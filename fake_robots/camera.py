"""A depth and colour camera in the world of a simulated robot, rendered in a thread of its own."""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from poise.assembly import RigidObject
from poise.fake_robots.depth_noise import D435, StereoNoise, measured
from poise.fake_robots.rasteriser import Body, Scene, render
from poise.fake_robots.stream import Message, TopicInfo
from poise.fake_robots.sweep_bag import CAMERA_TOPICS, image_bytes, info_bytes
from poise.geometry import Pose
from poise.scanning import Camera

_COLOURS = np.array(
    [
        [0.80, 0.36, 0.25],
        [0.30, 0.55, 0.75],
        [0.45, 0.65, 0.35],
        [0.85, 0.68, 0.30],
        [0.60, 0.45, 0.70],
        [0.35, 0.65, 0.65],
    ]
)
_FIXED = np.array([0.62, 0.56, 0.48])


@dataclass(frozen=True)
class Mounted:
    """A camera on a link.

    Args:
        parent, frame: the link, and the optical frame of images.
        pose: of the optical frame in the link.
        camera: intrinsics.
        rate: Hz.
        latency: s from the exposure to the message.
        noise: of the depth.
    """

    parent: str
    frame: str
    pose: Pose
    camera: Camera
    rate: float = 5.0
    latency: float = 0.2
    noise: StereoNoise = D435


class RenderedCamera:
    """Images of a world.

    Args:
        mounted: where it is, and its lens.
        seed: of the noise; each image has its own part of it.
        wanted: whether anybody would see the next image.
    """

    topics: ClassVar = {
        CAMERA_TOPICS[name]: TopicInfo(f"sensor_msgs/msg/{kind}", depth=5)
        for name, kind in {"depth": "Image", "colour": "Image", "info": "CameraInfo"}.items()
    }

    def __init__(self, mounted: Mounted, seed: int, wanted: Callable[[], bool] = lambda: True) -> None:
        self.mounted, self._seed, self.wanted = mounted, seed, wanted
        self._thread = ThreadPoolExecutor(1, "camera")

    def expose(self, number: int, stamp: int, optical: Pose, objects: Mapping[str, RigidObject]) -> Iterator[Message]:
        """One image, due `latency` after its stamp, ns; rendered until then.

        Args:
            number: of the image.
            stamp: ns.
            optical: pose of the optical frame in the world.
            objects: at their poses in the world.
        """
        if not self.wanted():
            return
        image = self._thread.submit(self._render, number, stamp, optical, dict(objects))
        due = stamp + round(self.mounted.latency * 1e9)
        yield Message(due, "", b"")  # others come first, until it is due
        yield from (Message(due, topic, data) for topic, data in image.result())

    def _render(
        self, number: int, stamp: int, optical: Pose, objects: Mapping[str, RigidObject]
    ) -> list[tuple[str, bytes]]:
        bodies = []
        for i, item in enumerate(objects.values()):
            corners = item.vertices[item.shape.polyhedron.triangles]
            colour = _FIXED if item.fixed else _COLOURS[i % len(_COLOURS)]
            bodies.append(Body(corners, np.tile(colour, (len(corners), 1))))
        mounted = self.mounted
        seen = render(Scene(tuple(bodies), table=None), mounted.camera, optical.rotation, optical.translation)
        rng = np.random.default_rng([self._seed, number])
        depth = measured(seen, mounted.camera.fx, mounted.noise, rng)
        return [
            (CAMERA_TOPICS["depth"], image_bytes(stamp, mounted.frame, depth, "16UC1")),
            (CAMERA_TOPICS["colour"], image_bytes(stamp, mounted.frame, seen.colours, "rgb8")),
            (CAMERA_TOPICS["info"], info_bytes(stamp, mounted.frame, mounted.camera)),
        ]
