"""The main job on a real recording: replayed through live nodes, its payload weighed, the answer shown."""

import os
import random
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import rclpy
from rclpy.node import Node
from rich.console import Console
from rich.live import Live
from rich.table import Table

from poise.errors import PoiseError
from poise.inertia.identification import Identification, identify
from poise.recording import open_recording
from poise.viewing.report import write_identification_report
from poise.viewing.rerun_scene import write_identification_recording
from poise_msgs.msg import InertialEstimate

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "demo"
console = Console()


@dataclass(frozen=True)
class Act:
    """One recording to replay, and how."""

    bag: str
    title: str
    method: str
    rate: float
    command: list[str] = field(default_factory=list)


ACTS = (
    Act("kuka_static_poses.mcap", "24 static poses", "static", rate=6.0),
    Act("kuka_free_motion.mcap", "6 s of free motion", "ols", rate=1.0),
)


def executable(name: str) -> Path:
    """Find a node the way `ros2 run poise NAME` does."""
    return Path(sys.prefix) / "lib" / "poise" / name


def start(name: str, **parameters: object) -> subprocess.Popen[str]:
    arguments = [item for key, value in parameters.items() for item in ("-p", f"{key}:={value}")]
    return subprocess.Popen([executable(name), "--ros-args", "--log-level", "warn", *arguments], text=True)


def row(table: Table, who: str, message: InertialEstimate) -> None:
    com = message.inertia.com
    mass_std = message.covariance[0] ** 0.5
    table.add_row(
        who,
        f"{message.inertia.m:.4f} ± {mass_std:.4f}",
        ", ".join(f"{1e3 * value:.1f}" for value in (com.x, com.y, com.z)),
        f"{message.residual_force:.3f}, {1e3 * message.residual_torque:.1f}",
        str(message.n_samples),
    )


def new_table(title: str) -> Table:
    table = Table(title=title, title_justify="left")
    for heading in ("", "mass kg", "centre of mass mm", "residual N, mN m", "samples"):
        table.add_column(heading, justify="right")
    return table


def replay_through_nodes(act: Act, gravity: float) -> InertialEstimate:
    """Run fake_robot -> inertial_estimator on one bag; show the estimate as it closes in; return the last one."""
    node = Node("demo")
    estimates: list[InertialEstimate] = []
    node.create_subscription(InertialEstimate, "inertial_estimate", estimates.append, 10)
    bag = ROOT / "bags" / act.bag
    estimator = start("inertial_estimator", method=act.method, gravity=gravity, publish_rate=20.0)
    robot = start("fake_robot", mode="replay", bag=bag, rate=act.rate, wait_for_subscribers="[wrench, tf]")
    try:
        deadline = time.monotonic() + 60.0
        quiet_since = None
        with Live(console=console, refresh_per_second=5, transient=True) as live:
            while quiet_since is None or time.monotonic() - quiet_since < 1.0:
                seen = len(estimates)
                rclpy.spin_once(node, timeout_sec=0.1)
                if estimates:
                    table = new_table(f"{act.title}, live at {act.rate:g} x")
                    row(table, "so far", estimates[-1])
                    live.update(table)
                # The bag is over when the player has left and the estimator has nothing new to say.
                if robot.poll() is None or len(estimates) > seen:
                    quiet_since = None
                elif quiet_since is None:
                    quiet_since = time.monotonic()
                if estimator.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError("the nodes did not finish; see their messages above")
    finally:
        for process in (robot, estimator):
            process.terminate()
        for process in (robot, estimator):
            process.wait(timeout=10)
        node.destroy_node()
    if not estimates:
        raise RuntimeError("no estimate arrived")
    return estimates[-1]


def show(act: Act, live: InertialEstimate, offline: Identification, report: Path) -> None:
    table = new_table(f"{act.title} ({act.bag})")
    row(table, "live nodes", live)
    console.print(table)
    mass = offline.estimate.parameters.mass
    console.print(f"  `poise identify` on the same bag: {mass:.4f} kg ({abs(live.inertia.m - mass):.0e} kg apart)")
    console.print(f"  report: {report}\n")


def main() -> None:
    # An own corner of the network, so that a robot on the desk is not disturbed.
    os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(60, 100)))
    console.print(
        "[bold]Poise[/bold]: a KUKA LBR Med 14 with an ATI Gamma sensor, recorded by A. Skrede (CC BY 4.0).\n"
        "Nobody weighed its payload. Bag → fake_robot → wrench, tf → inertial_estimator → the answer.\n"
    )
    rclpy.init()
    try:
        for act in ACTS:
            bag = ROOT / "bags" / act.bag
            recording = open_recording(bag)
            gravity = float(recording.metadata["poise"]["gravity"])
            live = replay_through_nodes(act, gravity)
            offline = identify(recording, method=act.method, gravity=gravity)
            folder = OUT / bag.stem
            report = write_identification_report(folder, offline, title=f"KUKA LBR Med: {act.title}", source=str(bag))
            write_identification_recording(folder / "identification.rrd", offline)
            show(act, live, offline, report)
    finally:
        rclpy.try_shutdown()
    scenes = f"{OUT.relative_to(ROOT)}/*/identification.rrd"
    console.print(f"Open the reports in a browser, or the motion in 3-D: .venv/bin/rerun {scenes}")


if __name__ == "__main__":
    try:
        main()
    except (PoiseError, RuntimeError) as error:
        console.print(f"[red]The demo stopped:[/red] {error}")
        sys.exit(1)
