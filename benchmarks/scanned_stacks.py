"""Scanned objects planned into stacks, and the true objects carried at their limits in MuJoCo, without nodes.

`python -m benchmarks.scanned_stacks [--tables 10] [--first 700] [--surface]`: random tables are looked at by a planned
sweep of a rendered camera. Each scan becomes a solid, of few facets or, with --surface, of its own surface, and is
planned onto the tray: picked, and placed from the hand. The stack gets the true weights, as if they had been weighed
without error. Then the true shapes stand where the plan puts the scanned ones, and the base accelerates.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio as pin

from poise.assembly import Analysis, Assembly, RigidObject, acceleration_limits, load_scene
from poise.baselines.placement import Engine
from poise.errors import PoiseError
from poise.fake_robots.depth_noise import D435, measured
from poise.fake_robots.rasteriser import Body, Scene, render
from poise.fake_robots.tables import TOP, random_table
from poise.files import write_whole
from poise.geometry import Pose
from poise.manipulation import (
    Arm,
    HeldReach,
    Limits,
    Reach,
    grasp_of_held,
    pick_steps,
    plan_look,
    plan_pick,
    plan_transfer,
    pose_of,
    steps_of,
    with_stops,
)
from poise.placement import Options, Steady, kept_free, plan_placement
from poise.robot import RobotModel
from poise.scanning import (
    Camera,
    Frame,
    ScanOptions,
    View,
    ViewRegion,
    chosen_places,
    depth_in_metres,
    places_of,
    scan,
    standing_mesh,
    united_surfaces,
)
from poise.shape import independent_parts, part_surface, segment
from poise.simulation import home
from poise.types import Array
from poise.world import settled, standing_object

EYE = "ft_sensor", Pose.from_vector([0.075, 0, -0.0175, 0, 0, 0.5**0.5, 0.5**0.5])
CAMERA = Camera(320, 240, 307.5, 307.5, 159.5, 119.5)
HEIGHT = 0.12
"""m of the region that is looked at, over the table."""
FRAMES = 127
SECONDS = 30.0
"""s of each plan."""
SPEED = 0.5
"""m/s of the tool."""
COSTS = "pick", "stops of a pick", "place", "stops of a placement", "limits"
SHARES = (0.8, 1.0, 1.5)
"""Of the limits; `object_carrier` uses 0.8 at most."""
DIRECTIONS = 4
MOVED, STOOD = 0.002, 0.01
"""m that an object moves under acceleration, to count; and while it settles, to count as fallen."""


@dataclass(frozen=True)
class Scanned:
    """A true object, and its scanned solid with the true weight, where it lies."""

    true: RigidObject
    item: RigidObject


@cache
def _arm() -> Arm:
    return replace(Arm.load("fr3"), base=pin.SE3(np.eye(3), np.array([0.0, 0.0, TOP])))


@cache
def _start() -> Array:
    return home(RobotModel.from_file("fr3", EYE[0]))


def views_of(scene: Assembly, seed: int) -> tuple[list[View], ViewRegion]:
    """What the camera sees on a planned sweep over the table, and the region."""
    arm = _arm()
    fixed = [item for item in scene.objects if item.fixed]
    table = next(item for item in fixed if item.id == "table").vertices
    low, high = table.min(axis=0), table.max(axis=0)
    middle = np.array([*(low + high)[:2] / 2, high[2] + HEIGHT / 2])
    region = ViewRegion(Pose(np.eye(3), middle), np.array([*(high - low)[:2], HEIGHT]))
    motion = plan_look(arm, EYE, CAMERA, region, fixed, _start()).motion
    bodies = [item.vertices[item.shape.polyhedron.triangles] for item in scene.objects]
    drawn = Scene(tuple(Body(each, np.full((len(each), 3), 0.6)) for each in bodies), table=None)
    rng, data, views = np.random.default_rng(seed), arm.model.createData(), []
    for number, q in enumerate(motion.at(np.linspace(0.0, motion.duration, FRAMES)).position):
        pin.framesForwardKinematics(arm.model, data, q)
        at = arm.base * data.oMf[arm.model.getFrameId(EYE[0])] * pin.SE3(EYE[1].rotation, EYE[1].translation)
        seen = render(drawn, CAMERA, at.rotation, at.translation)
        depth = depth_in_metres(measured(seen, CAMERA.fx, D435, rng), "16UC1", unit=D435.step)
        views.append(View(Frame(number * 10**8, "eye", CAMERA, depth, seen.colours), at.rotation, at.translation))
    return views, region


def scans_of(scene: Assembly, seed: int, own_surface: bool) -> Iterator[Scanned]:
    """Each object that is found on the table."""
    views, region = views_of(scene, seed)
    fixed = Assembly(tuple(item for item in scene.objects if item.fixed), scene.gravity, scene.friction)
    how = ScanOptions(farthest=0.9)
    for place in chosen_places(places_of(views, how), region, None, True):
        found = scan(views, replace(how, near=place))
        parts = segment(found.points, found.colours)
        labels = independent_parts(parts)
        surfaces = [part_surface(parts.solid, labels, part) for part in range(int(labels.max()) + 1)]
        joined = united_surfaces([(vertices - found.foot, triangles) for vertices, triangles in surfaces])
        cloud = (None, None) if own_surface else (found.points - found.foot, found.seen)
        made = standing_mesh(*joined, "scan", *cloud)
        movable = [item for item in scene.objects if not item.fixed]
        true = min(movable, key=lambda item: float(np.linalg.norm((item.pose.translation - found.foot)[:2])))
        item = standing_object(true.id, made, Pose(np.eye(3), found.foot), true.mass)
        yield Scanned(true, weighed(settled(item, fixed, 0.01), true))


def weighed(item: RigidObject, true: RigidObject) -> RigidObject:
    """The scanned object with the weight of the true one that lies there."""
    turn = item.pose.rotation
    inertia = turn.T @ true.inertia_in_world @ turn
    return replace(item, mass=true.mass, com=item.pose.undo(true.com_in_world), inertia=inertia)


def stacked(scene: Assembly, scans: list[Scanned], costs: dict[str, list[float]]) -> tuple[Assembly, Assembly]:
    """The stack on the tray that is planned, and that of the true objects; what finds no way or place is left out."""
    arm, fixed = _arm(), [item for item in scene.objects if item.fixed]
    now = Assembly((*fixed, *(each.item for each in scans)), scene.gravity, scene.friction)
    placed: list[tuple[RigidObject, RigidObject]] = []
    for each in sorted(scans, key=lambda one: -one.item.shape.volume):
        begun = time.process_time()
        try:
            rest = Analysis.of(now.without(each.item.id))
            pick = plan_pick(Reach(arm, rest, each.item, start=_start()), seconds=SECONDS)
            costs["pick"].append(time.process_time() - begun)
            begun = time.process_time()
            pick_steps(pick, each.item, arm, SPEED)
            costs["stops of a pick"].append(time.process_time() - begun)
            begun = time.process_time()
            grasp = grasp_of_held(each.item, pose_of(pick.grasp.object_tcp.inverse()), arm)
            reach = HeldReach(arm, rest, each.item, grasp, _start(), 0)
            reach.require_free_start()
            reach.require_pick()
            looks = (*kept_free(rest.assembly, ["table"]), *reach.looks)
            tests = (("tips easily", Steady(1e-3)), *reach.tests)
            options = Options(deadline=SECONDS, candidates=3, tests=tests, looks=looks)
            found = plan_placement(rest, reach.item, options)
            transfer = plan_transfer(reach, found.analysis, found.item, Limits(), SECONDS)
            costs["place"].append(time.process_time() - begun)
            begun = time.process_time()
            held = transfer.grasp.object_tcp.inverse().act(reach.item.pose.undo(reach.item.com_in_world))
            with_stops(steps_of(transfer, SPEED), arm, held, transfer.ends.hold)
            costs["stops of a placement"].append(time.process_time() - begun)
        except PoiseError as error:
            print(f"{each.item.id} is left out: {error.message}")
            continue
        now = found.analysis.assembly
        true = replace(each.true, pose=found.pose @ each.item.pose.inverse @ each.true.pose)
        placed.append((found.item, true))
    carried = [item for item in fixed if item.id != "table"]
    planned, true_ones = zip(*placed, strict=True) if placed else ((), ())
    return tuple(Assembly((*carried, *items), scene.gravity, scene.friction) for items in (planned, true_ones))  # type: ignore[return-value]


def carried(planned: Assembly, true: Assembly, costs: dict[str, list[float]]) -> dict[str, list[list[float]]]:
    """For each share of the limits and each direction, m that each object moves in MuJoCo."""
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    ways = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    begun = time.process_time()
    limits = acceleration_limits(Analysis.of(planned), ways, 60.0, turning=False).limits
    costs["limits"].append(time.process_time() - begun)
    return {str(share): [moves(true, share * a * way) for a, way in zip(limits, ways, strict=True)] for share in SHARES}


def moves(stack: Assembly, acceleration: Array) -> list[float]:
    """m that each object moves while the base accelerates for a second, after it has settled; NaN: fell before."""
    engine = Engine(stack, 1e-3, damping=20.0)
    engine.run(0.5)
    engine.calm(0.0)
    engine.run(0.25)
    before = engine.poses
    names = [item.id for item in stack.objects if not item.fixed]
    if any(
        np.linalg.norm(before[item.id].translation - item.pose.translation) > STOOD
        for item in stack.objects
        if not item.fixed
    ):
        return [float("nan")] * len(names)
    for share in np.linspace(0.05, 1.0, 20):
        engine.set_gravity(np.asarray(stack.gravity) - share * acceleration)
        engine.run(0.025)
    engine.run(1.0)
    return [engine.moved({name: before[name]}) for name in names]


def main() -> None:
    """Print the table of docs/loop.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=int, default=10)
    parser.add_argument("--first", type=int, default=700, help="first seed")
    parser.add_argument("--objects", type=int, default=5)
    parser.add_argument("--surface", action="store_true", help="solids with the surface of the scan, as before")
    parser.add_argument("--no-carry", action="store_true", help="planning alone")
    parser.add_argument("--quick", action="store_true", help="one table of three objects")
    parser.add_argument("--json", type=Path, help="write all results there")
    given = parser.parse_args()
    tables, objects = (1, 3) if given.quick else (given.tables, given.objects)
    costs: dict[str, list[float]] = {name: [] for name in COSTS}
    results: list[dict[str, Any]] = []
    for seed in range(given.first, given.first + tables):
        with TemporaryDirectory() as folder:
            scene = load_scene(random_table(objects, np.random.default_rng(seed), Path(folder)))
            scans = list(scans_of(scene, seed, given.surface))
        planned, true = stacked(scene, scans, costs)
        ratios = [each.item.shape.volume / each.true.shape.volume for each in scans]
        facets = [len(each.item.shape.polyhedron.normals) for each in scans]
        found = {} if given.no_carry or len(true.objects) < 2 else carried(planned, true, costs)
        results.append(
            {"seed": seed, "volumes": ratios, "facets": facets, "placed": len(true.objects) - 1, "moved": found}
        )
        print(json.dumps(results[-1], default=float), flush=True)
    show(results, costs)
    if given.json:
        write_whole(given.json, json.dumps({"results": results, "costs": costs}, indent=1).encode())


def show(results: list[dict[str, Any]], costs: dict[str, list[float]]) -> None:
    """The table."""
    facets, volumes = ([value for each in results for value in each[key]] for key in ("facets", "volumes"))
    print(f"| facets of a solid, median and most | {np.median(facets):.0f}, {max(facets)} |")
    print(f"| volume by the true one, mean and deviation | {np.mean(volumes):.3f}, {np.std(volumes):.3f} |")
    print(f"| placed | {sum(each['placed'] for each in results)} of {len(facets)} |")
    for name, seconds in costs.items():
        if seconds:
            print(f"| {name}, CPU s, mean and most | {np.mean(seconds):.2f}, {max(seconds):.2f} |")
    for share in map(str, SHARES):
        rows = [row for each in results for row in each["moved"].get(share, [])]
        stood = [row for row in rows if not np.isnan(row).any()]
        if rows:
            moved = [np.array(row) > MOVED for row in stood]
            print(
                f"| at {share} x the limits: objects that moved by over 2 mm; ways with one; ways of stacks that fell"
                f" before | {sum(each.sum() for each in moved)} of {sum(map(len, moved))};"
                f" {sum(each.any() for each in moved)} of {len(stood)}; {len(rows) - len(stood)} |"
            )


if __name__ == "__main__":
    main()
