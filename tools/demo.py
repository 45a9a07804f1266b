"""Weighs the payload of two real recordings by live nodes and from the files, and shows that both agree."""

import os
import random
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.node import Node
from rich.console import Console
from rich.live import Live
from rich.table import Table

from poise.errors import PoiseError
from poise.inertia.pipeline import identify
from poise.recording import open_recording
from poise.viewing import write_identification_recording, write_identification_report
from poise_msgs.msg import InertialEstimate

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "demo"
console = Console()

QUIET = 0.5  # s without a new estimate, after the player has left
PATIENCE = 60.0  # s


@dataclass(frozen=True)
class Act:
    """One recording to replay; the name is its namespace on the graph, the rate a multiple of real time."""

    name: str
    title: str
    rate: float

    @property
    def bag(self) -> Path:
        return ROOT / "bags" / f"kuka_{self.name}.mcap"


ACTS = (
    Act("static_poses", "24 static poses", rate=8.0),
    Act("free_motion", "6 s of free motion", rate=1.0),
)


class Replay:
    """fake_robot -> inertial_estimator on one recording, in a separate namespace, and the estimates so far."""

    def __init__(self, act: Act, listener: Node) -> None:
        self.act = act
        self.recording = open_recording(act.bag)
        self.gravity = float(self.recording.metadata["poise"]["gravity"])
        self.estimates: list[InertialEstimate] = []
        listener.create_subscription(InertialEstimate, f"{act.name}/inertial_estimate", self._take, 10)
        self.news = time.monotonic()
        self.estimator = self._start("inertial_estimator", gravity=self.gravity, publish_rate=20.0)
        self.robot = self._start("fake_robot", bag=act.bag, rate=act.rate, wait_for_subscribers="[wrench, tf]")

    def _start(self, executable: str, **parameters: object) -> subprocess.Popen[bytes]:
        """Start a node as `ros2 run poise NAME` would."""
        arguments = [item for key, value in parameters.items() for item in ("-p", f"{key}:={value}")]
        command = [Path(sys.prefix) / "lib" / "poise" / executable, "--ros-args", "--log-level", "warn"]
        return subprocess.Popen([*command, "-r", f"__ns:=/{self.act.name}", *arguments])

    def _take(self, estimate: InertialEstimate) -> None:
        self.estimates.append(estimate)
        self.news = time.monotonic()

    @property
    def is_over(self) -> bool:
        """The player has ended, and the estimator has published its last estimate."""
        if self.estimator.poll() is not None or self.robot.poll() not in (None, 0):
            raise RuntimeError(f"a node of {self.act.title} ended early; its own message is above")
        return self.robot.poll() == 0 and bool(self.estimates) and time.monotonic() - self.news > QUIET

    def stop(self) -> None:
        for process in (self.robot, self.estimator):
            process.terminate()
        for process in (self.robot, self.estimator):
            process.wait(timeout=10)


def table_of(replays: list[Replay], title: str) -> Table:
    table = Table(title=title, title_justify="left")
    for heading in ("", "mass kg", "centre of mass mm", "residual N, mN m", "samples"):
        table.add_column(heading, justify="right")
    for replay in replays:
        if not replay.estimates:
            table.add_row(replay.act.title, "…")
            continue
        message = replay.estimates[-1]
        com = message.inertia.com
        table.add_row(
            replay.act.title,
            f"{message.inertia.m:.4f} ± {message.covariance[0] ** 0.5:.4f}",
            ", ".join(f"{1e3 * value:.1f}" for value in (com.x, com.y, com.z)),
            f"{message.residual_force:.3f}, {1e3 * message.residual_torque:.1f}",
            str(message.n_samples),
        )
    return table


def watch(replays: list[Replay], listener: Node) -> None:
    """Show the estimates as they converge, until every recording has ended."""
    deadline = time.monotonic() + PATIENCE
    with Live(console=console, refresh_per_second=5, transient=True) as live:
        while not all(replay.is_over for replay in replays):
            if time.monotonic() > deadline:
                raise RuntimeError(f"no answer within {PATIENCE:.0f} s")
            rclpy.spin_once(listener, timeout_sec=0.1)
            live.update(table_of(replays, "The live nodes, so far"))
    console.print(table_of(replays, "The live nodes"))


def report(replay: Replay) -> tuple[float, Path]:
    """Weigh the recording from its file; write the report and the Rerun recording; return the mass and the page."""
    act = replay.act
    from_file = identify(replay.recording, gravity=replay.gravity)
    folder = OUT / act.name
    page = write_identification_report(folder, from_file, title=f"KUKA LBR Med: {act.title}", source=str(act.bag))
    write_identification_recording(folder / "identification.rrd", from_file)
    return from_file.estimate.parameters.mass, page.relative_to(ROOT)


def main() -> None:
    # A separate ROS domain, so that a robot on the network is not disturbed.
    os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(60, 100)))
    # The nodes discover one another in tenths of a second; with the default settings it can take three seconds.
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
    os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(ROOT / "config" / "localhost_udp.xml")
    console.print(
        "[bold]Poise[/bold]: a KUKA LBR Med 14 with an ATI Gamma sensor, recorded by A. Skrede (CC BY 4.0).\n"
        "The mass of its payload is unknown. Bag → fake_robot → wrench, tf → inertial_estimator → estimate.\n"
    )
    rclpy.init()
    replays: list[Replay] = []
    try:
        listener = Node("demo")
        for act in ACTS:
            replays.append(Replay(act, listener))
        with ThreadPoolExecutor(1) as pool:
            reports = [pool.submit(report, replay) for replay in replays]
            watch(replays, listener)
    finally:
        for replay in replays:
            replay.stop()
        rclpy.try_shutdown()
    for replay, written in zip(replays, reports, strict=True):
        mass, page = written.result()
        estimate = replay.estimates[-1]
        apart = abs(estimate.inertia.m - mass)
        share = apart / estimate.covariance[0] ** 0.5
        console.print(
            f"{replay.act.title}: live {estimate.inertia.m:.4f} kg, `poise identify` {mass:.4f} kg; "
            f"they differ by {apart:.0e} kg, {share:.0e} of one sigma.",
            soft_wrap=True,
        )
        console.print(f"  report: {page}", soft_wrap=True)
    console.print(f"The motion in 3-D: .venv/bin/rerun {OUT.relative_to(ROOT)}/*/identification.rrd", soft_wrap=True)


if __name__ == "__main__":
    try:
        main()
    except (PoiseError, RuntimeError) as error:
        console.print(f"[red]The demo stopped:[/red] {error}")
        sys.exit(1)
