"""Makes the pictures in docs/pictures from the committed recordings; screenshots too where Chromium is installed."""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import matplotlib
from mismatch_pictures import arm_panels, emps_panels, mismatch_pictures
from simulator_pictures import against_panels, compare_panels, rollout_panels

from poise.assembly import Analysis, acceleration_limits, assess, load_scene, robustness_map
from poise.commands.assembly import read_pushes
from poise.excitation import Guard, MotionLimits, plan_excitation, tool_centre
from poise.inertia.pipeline import Identification, identify
from poise.recording import open_recording
from poise.robot import RobotModel
from poise.simulation import home
from poise.viewing import assembly_figures, excitation_panels, figures, write_identification_report
from poise.viewing.canvas import STYLE, Panel, sheet, write_picture

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
SCENES = ROOT / "docs" / "scenes"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
LIGHT, DARK = "--blink-settings=preferredColorScheme=1", "--blink-settings=preferredColorScheme=0"
BROWSER_SECONDS = 60
# The pages show when they were made; the recording's own day keeps the pictures the same from run to run.
RECORDED = datetime(2024, 2, 25, tzinfo=UTC)


def save(name: str, panels: Sequence[Panel], columns: int) -> None:
    """Draw panels on one sheet and write it as a PNG."""
    path = PICTURES / f"{name}.png"
    with matplotlib.rc_context(STYLE):
        sheet(panels, columns).savefig(path, dpi=108, metadata={"Software": None}, pil_kwargs={"optimize": True})
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1024} KiB")


def save_screenshot(name: str, page: Path, width: int, height: int, scheme: str) -> None:
    """Photograph the top of a page with a headless browser; say so when there is none."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f"{name}.png left as it was: it needs one of {', '.join(BROWSERS)}")
        return
    path = PICTURES / f"{name}.png"
    with tempfile.TemporaryDirectory() as profile:
        options = (*BROWSER_OPTIONS, scheme, f"--user-data-dir={profile}", f"--window-size={width},{height}")
        command = [browser, *options, f"--screenshot={path}", page.as_uri()]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL, timeout=BROWSER_SECONDS)
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1024} KiB")


def weigh(bag: str, method: str) -> Identification:
    return identify(open_recording(ROOT / "bags" / bag), method=method)


def swing() -> list[Panel]:
    """The panels of `poise excite fr3 --radius 0.12`."""
    robot = RobotModel.from_file("fr3")
    guard, limits = Guard.ball(tool_centre(robot, "tcp"), 0.12), MotionLimits()
    return excitation_panels(robot, plan_excitation(robot, home(robot), guard, limits), guard, limits.speed)


def save_assembly() -> None:
    """The loaded tray of docs/scenes: what touches what, what it bears, how it gives way, how fast it may go."""
    analysis = Analysis.of(load_scene(SCENES / "tray.yaml"))
    pushes = read_pushes(SCENES / "pushes.json")
    results = assess(analysis, pushes).results
    weakest = min(range(len(pushes)), key=lambda row: results[row].robustness)
    for name, panel in (
        ("contact_graph", assembly_figures.graph_panel(analysis)),
        ("robustness_map", assembly_figures.map_panel(robustness_map(analysis))),
        ("mechanism", assembly_figures.mechanism_panel(analysis, pushes[weakest], results[weakest])),
        ("acceleration_limits", assembly_figures.limits_panel(acceleration_limits(analysis))),
    ):
        path = write_picture([panel], PICTURES / f"{name}.png")
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1024} KiB")


def main() -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    static = weigh("kuka_static_poses.mcap", "static")
    motion = weigh("kuka_free_motion.mcap", "ols")
    save_assembly()
    save("wrench", figures.wrench_panels(motion), columns=3)
    save("residual", figures.residual_panels(motion), columns=3)
    save("closing_in", figures.convergence_panels(static), columns=2)
    save("motion", figures.motion_panels(motion), columns=3)
    save("directions", [figures.sphere_panel(static), figures.sphere_panel(motion)], columns=2)
    save("excitation", swing(), columns=2)
    save("mismatch_emps", emps_panels(), columns=2)
    save("tutorial_arm", arm_panels(), columns=2)
    save("compare", compare_panels(), columns=3)
    save("against", against_panels(), columns=3)
    save("rollout", rollout_panels(), columns=3)
    with tempfile.TemporaryDirectory() as folder:
        page = write_identification_report(
            Path(folder),
            static,
            "KUKA LBR Med: 24 static poses",
            "bags/kuka_static_poses.mcap",
            command="poise identify bags/kuka_static_poses.mcap --report out",
            now=RECORDED,
        )
        save_screenshot("report", page, 1200, 1350, LIGHT)
        save_screenshot("report_dark", page, 1200, 1350, DARK)
    mismatch_pictures(
        lambda name, page: save_screenshot(name, page, 1200, 1500, LIGHT),
        command="poise mismatch run.mcap --model model.yaml --report out",
        now=RECORDED,
    )


if __name__ == "__main__":
    main()
