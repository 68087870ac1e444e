"""What the command line does. Needs the extra `cli`."""

import json
import sys
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

import redundancy as rd
from redundancy import _check, _motion, _painting, _plan, plot

DONE, CANNOT_FOLLOW, BAD_INPUT, STOPPED = 0, 1, 2, 130

# What `track` leaves behind.
RESULTS = (
    "trajectory.csv",
    "trajectory.json",
    "summary.json",
    "animation.json",
    "track.png",
    "swivel.png",
    "obstacles.png",
)

# Points per step of the progress bar, and from how many points there is one.
_CHUNK = 2_000
_LONG = 5_000
# Points that the swivel plot shows at most.
_PLOTTED = 2_000

_out = Console(highlight=False)
_err = Console(stderr=True, highlight=False)

app = typer.Typer(
    name="redundancy",
    help="Redundancy resolution for robot arms: configurations along whole paths, within all limits.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        _out.print(f"redundancy {rd.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


class CannotFollowError(Exception):
    """The path is sound, the arm cannot follow it."""


class StoppedError(Exception):
    """Ctrl-C; the command line library would turn KeyboardInterrupt into exit status 1."""


def run(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    try:
        app(args=arguments, prog_name="redundancy")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else DONE
    except (CannotFollowError, rd.CannotFollowError) as error:
        return _fail(CANNOT_FOLLOW, f"cannot be followed: {error}")
    except (rd.RedundancyError, OSError) as error:
        return _fail(BAD_INPUT, str(error))
    except StoppedError:
        return _fail(STOPPED, "stopped")
    return DONE


def _fail(status: int, message: str) -> int:
    _err.print(f"[bold red]redundancy:[/] {escape(message)}", soft_wrap=True)
    return status


# --- robots -----------------------------------------------------------------------------------------------

# What the numbers of the catalogue are taken from; the details are in docs/chain.md.
SOURCES = {
    "dexter": ("Scienza Machinale DEXTER", "Bettini, De Luca, Oriolo 2000"),
    "fr3": ("Franka Research 3", "franka_description 566ba44"),
    "gen3": ("Kinova Gen3, 7 joints", "ros2_kortex 1fdbef3"),
    "iiwa14": ("KUKA LBR iiwa 14 R820", "KUKA specification; inertias of Drake's URDF"),
    "irb2400": ("ABB IRB 2400", "ros-industrial/abb 77db19b"),
    "kr6_r900": ("KUKA KR 6 R900 sixx", "kuka_robot_descriptions 7766e92"),
    "openarm": ("Enactic OpenArm v1.0", "openarm_description af6f035"),
    "pa10": ("Mitsubishi PA10-7C", "Moore, Oztop 2010; Mitsubishi specification"),
    "panda": ("Franka Emika Panda", "Franka Control Interface; Gaz et al. 2019"),
    "planar3r": ("planar arm, 3 links", "Park, Chung, Youm 1996"),
    "planar4r": ("planar arm, 4 links", "Park, Chung, Youm 1996, a link added"),
    "puma560": ("Unimation PUMA 560", "Corke, Armstrong-Helouvry 1994"),
    "rby1": ("Rainbow RB-Y1, right arm", "rby1-sdk 38df326"),
    "rizon4": ("Flexiv Rizon 4", "flexiv_ros2 9d96a86"),
    "sawyer": ("Rethink Robotics Sawyer", "sawyer_robot d1ef3d0"),
    "unitree_g1": ("Unitree G1, left arm", "unitree_ros 5ae4fa5"),
    **{
        name: (
            f"Universal Robots {name.upper().replace('E', 'e')}",
            "Universal_Robots_ROS2_Description 2221ec0",
        )
        for name in ("ur3e", "ur5e", "ur10e", "ur16e", "ur20", "ur30")
    },
    "xarm7": ("UFACTORY xArm 7", "xarm_ros2 3654ba7"),
}


@app.command()
def robots() -> None:
    """List the arms of the built-in catalogue.

    Reach is the length of the arm from the base to the tool when stretched out:
    no point farther away can be reached.

    Example:  redundancy robots
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("name", "arm", "joints", "reach (m)", "limits", "closed form", "source"):
        right = column in {"joints", "reach (m)"}
        table.add_column(
            column, overflow="fold", justify="right" if right else "left", no_wrap=column == "name"
        )
    for name in rd.catalog.names():
        chain = rd.catalog.load(name)
        known = {
            "pos": np.r_[chain.lower, chain.upper],
            "vel": chain.velocity_limit,
            "acc": chain.acceleration_limit,
            "torque": chain.effort_limit,
        }
        limits = " ".join(kind for kind, values in known.items() if np.isfinite(values).any()) or "none"
        form = rd.closed_form(chain)
        closed = "" if form is None else form.name
        arm, source = SOURCES.get(name, ("", ""))
        table.add_row(name, arm, str(chain.dof), f"{_reach(chain):.3f}", limits, closed, source)
    # Into a file or a pipe one line per robot, whatever the width.
    console = _out if _out.is_terminal else Console(width=160, highlight=False)
    console.print(table)


def _reach(chain: rd.Chain) -> float:
    """Distances from frame to frame, added up."""
    zero = np.zeros(chain.dof)
    points = [chain.forward(zero, link=link)[:3, 3] for link in chain.link_names]
    points.append(chain.forward(zero)[:3, 3])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


# --- bodies -----------------------------------------------------------------------------------------------

SceneOption = Annotated[
    File | None,
    typer.Option(
        "--scene",
        "--obstacles",
        help="Scene JSON: spheres, boxes, capsules, cylinders, planes, meshes. --obstacles is another name for it.",
    ),
]
CollisionOption = Annotated[
    str,
    typer.Option(
        help="Shapes of the links: capsules (from joint to joint), urdf (its collision geometry; self-collision is "
        "checked too), none (obstacles are ignored)."
    ),
]
SrdfOption = Annotated[
    File | None,
    typer.Option(
        help="With --collision urdf: SRDF file with the links that may touch; found by sampling without it."
    ),
]
PackageOption = Annotated[
    list[File] | None,
    typer.Option(
        help="With --collision urdf: folder that contains the ROS packages of meshes; may be repeated."
    ),
]


# --- track ------------------------------------------------------------------------------------------------


@app.command()
def track(
    robot: Annotated[str, typer.Option(help="Name from `redundancy robots`, or a URDF file.")],
    path: Annotated[File, typer.Option(help="CSV: x,y,z (m), qw,qx,qy,qz, and optionally t (s) or s (m).")],
    out: Annotated[File, typer.Option(help="Folder for the results; created if needed.")],
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    swivel: Annotated[
        str, typer.Option(help="auto, or the swivel angle of the elbow to hold, in degrees.")
    ] = "auto",
    desired_swivel: Annotated[
        float | None,
        typer.Option(help="Swivel angle to stay near, in degrees, as far as limits and obstacles allow."),
    ] = None,
    branch: Annotated[
        str, typer.Option(help="auto, or signs of shoulder, elbow, wrist, such as +++ or +-+.")
    ] = "auto",
    obstacles: SceneOption = None,
    collision: CollisionOption = "capsules",
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    plan: Annotated[
        str,
        typer.Option(
            help="whole: plans the swivel of the whole path at once; flow: step by step, as in real time."
        ),
    ] = "whole",
    clearance: Annotated[float, typer.Option(help="Wanted distance from the obstacles, m.")] = 0.03,
    link_radius: Annotated[float, typer.Option(help="Radius of the links as capsules, m.")] = 0.05,
    cyclic: Annotated[
        bool, typer.Option(help="End in the configuration of the start; the path must be closed.")
    ] = False,
    retime: Annotated[
        bool,
        typer.Option(
            "--retime",
            help="Replace the path's own times by the fastest ones within the limits; those of jerk are assumed.",
        ),
    ] = False,
    plots: Annotated[bool, typer.Option(help="Whether to draw the PNGs.")] = True,
) -> None:
    """Follow a path of tool poses with a seven-joint S-R-S arm, without jumps, away from limits and obstacles.

    Writes trajectory.csv, trajectory.json (field names of ROS JointTrajectory),
    summary.json and PNGs; with obstacles also animation.json: positions of
    joints and obstacles in space, row by row. If the path has times, they are
    kept, and limits that they violate are reported; otherwise the motion goes
    from rest to rest as fast as the limits allow.
    Exit status: 0 done, 1 the path cannot be followed, 2 bad input.

    Example:  redundancy track --robot pa10 --path path.csv --out run/
    Example:  redundancy track --robot arm.urdf --base base_link --tip tool0 --path path.csv --swivel 30 --out run/
    Example:  redundancy track --robot pa10 --path path.csv --scene scene.json --plan whole --out run/
    Example:  redundancy track --robot arm.urdf --path path.csv --collision urdf --package-dir share/ --out run/
    Example:  redundancy track --robot pa10 --path path.csv --scene scene.json --desired-swivel -90 --out run/
    """
    if plan not in {"whole", "flow"}:
        raise rd.RedundancyError(f"--plan is '{plan}', it must be whole or flow")
    if desired_swivel is not None and swivel != "auto":
        raise rd.RedundancyError(
            "--swivel holds the swivel, --desired-swivel only asks for it: give one of them"
        )
    if desired_swivel is not None and not np.isfinite(desired_swivel):
        raise rd.RedundancyError(
            f"--desired-swivel is {desired_swivel}, it must be a finite angle in degrees"
        )
    desired = None if desired_swivel is None else float(np.deg2rad(desired_swivel))
    bodies = bodies_of(collision, srdf, package_dir)
    way = Way(obstacles, plan, clearance, link_radius, cyclic, desired, bodies=bodies)
    Job(robot, path, out, base, tip, _swivel(swivel), _branch(branch), plots, way, retime).run()


def _first_fault(plan: rd.SwivelPlan, points: int) -> int:
    """The first row that a plan reports: without a configuration, beyond a limit, a jump, or in contact."""
    rows = [*plan.blocked, *plan.reconfigurations, *(event.index for event in plan.events)]
    if plan.clearance is not None:
        rows += np.flatnonzero(plan.clearance < 0.0).tolist()
    return int(min([*rows, points - 1]))


@dataclass
class Bodies:
    """What the arm is when it comes near something."""

    collision: str = "capsules"
    srdf: File | None = None
    package_dirs: list[File] = field(default_factory=list)

    def links(self, robot: str, chain: rd.Chain) -> rd.LinkGeometry | None:
        """The shapes of a URDF's links, or None for capsules."""
        if self.collision != "urdf":
            return None
        if not File(robot).is_file():
            raise rd.RedundancyError(f"--collision urdf needs a URDF file, '{robot}' is none")
        return rd.LinkGeometry.from_urdf(chain, robot, package_dirs=self.package_dirs, srdf=self.srdf)


def bodies_of(collision: str, srdf: File | None, package_dir: list[File] | None) -> Bodies:
    """What the options of a command say the arm is."""
    if collision not in {"urdf", "capsules", "none"}:
        raise rd.RedundancyError(f"--collision is '{collision}', it must be urdf, capsules or none")
    if collision != "urdf" and (srdf is not None or package_dir):
        raise rd.RedundancyError("--srdf and --package-dir need --collision urdf")
    return Bodies(collision, srdf, list(package_dir or []))


@dataclass
class Way:
    """How the swivel is found, and beside what."""

    obstacles: File | None = None
    plan: str = "whole"
    clearance: float = 0.03
    link_radius: float = 0.05
    cyclic: bool = False
    desired: float | None = None
    scene: rd.Scene | None = None
    bodies: Bodies = field(default_factory=Bodies)
    links: rd.LinkGeometry | None = None


@dataclass
class Job:
    """One run of `track`."""

    robot: str
    path_file: File
    out: File
    base: str | None = None
    tip: str | None = None
    swivel: float | None = None
    branch: tuple[int, int, int] | None = None
    plots: bool = True
    way: Way = field(default_factory=Way)
    retime: bool = False
    summary: dict[str, Any] = field(default_factory=dict)

    def run(self) -> None:
        """Read, check, plan, measure, write."""
        try:
            self._run()
        except KeyboardInterrupt as error:
            raise StoppedError from error

    def _run(self) -> None:
        begin = time.perf_counter()
        chain = load_robot(self.robot, self.base, self.tip)
        arm = rd.SrsArm(chain)
        path = rd.Path.from_csv(self.path_file)
        if not path.has_orientation:
            message = (
                f"{self.path_file}: the path has positions only; a 7-joint arm needs qw,qx,qy,qz as well"
            )
            raise rd.RedundancyError(message)
        if self.way.obstacles is not None:
            self.way.scene = rd.Scene.from_json(self.way.obstacles)
        self.way.links = self.way.bodies.links(self.robot, chain)
        if self.way.bodies.collision == "none":
            self.way.scene = None
        if self.way.plan == "flow" and path.t is None:
            message = f"{self.path_file}: --plan flow needs a path with times (a column t)"
            raise rd.RedundancyError(message)
        self.out.mkdir(parents=True, exist_ok=True)
        for name in RESULTS:  # nothing of an earlier run may stand beside the new summary
            (self.out / name).unlink(missing_ok=True)
        self.summary = {
            "robot": chain.name,
            "robot_source": self.robot,
            "path": str(self.path_file),
            "points": len(path),
            "length_m": path.length,
            "swivel_held_rad": self.swivel,
            "swivel_desired_rad": self.way.desired,
        }
        with _progress(len(path)) as progress:
            try:
                self._check(arm, path, progress)
                plan = self._plan(arm, path, progress)
            except CannotFollowError as failure:
                self._give_up(arm, path, str(failure))
                raise
            keep = path.t is not None and not self.retime
            motion, self.summary["timing"] = _motion.timed(chain, plan, keep)
            for event in self.summary["events"]:
                event["t"] = float(motion.t[event["index"]])
            self._measure(chain, path, plan, motion, progress)
            _motion.write_csv(motion, self.out / "trajectory.csv")
            motion.to_json(self.out / "trajectory.json")
            written = ["trajectory.csv", "trajectory.json", "summary.json"]
            if self.way.scene is not None:
                self._animate(chain, plan, motion, self.way.scene)
                written.append("animation.json")
            if self.plots:
                self._draw(arm, path, plan, motion)
                written.append("track.png")
                if self.way.scene is not None:
                    links = self.way.link_radius if self.way.links is None else self.way.links
                    figure = plot.obstacle_map(arm, path, plan, self.way.scene, links)
                    _save(figure, self.out / "obstacles.png")
                    written.append("obstacles.png")
        self.summary["seconds"] = time.perf_counter() - begin
        self._write_summary()
        self._report(written)

    def _check(self, arm: rd.SrsArm, path: rd.Path, progress: Progress) -> None:
        """Refuse points that no configuration reaches within the limits."""
        poses, total = path.poses, len(path)
        task = progress.add_task("reach and limits", total=total)
        reached, held = np.zeros(total, bool), np.zeros(total, bool)
        only = None if self.branch is None else _branch_index(self.branch)
        for first in range(0, total, _CHUNK):
            block = poses[first : first + _CHUNK]
            reached[first : first + _CHUNK] = arm.solve_batch(block, 0.0, limits=False).valid.any(axis=1)
            owners, _ = arm.intervals_batch(block)
            rows = owners[:, 0] if only is None else owners[owners[:, 1] == only, 0]
            held[first + rows] = True
            progress.update(task, advance=len(block))
        far, blocked = np.flatnonzero(~reached), np.flatnonzero(reached & ~held)
        self.summary["unreachable_points"], self.summary["points_outside_limits"] = len(far), len(blocked)
        if len(far) == 0 and len(blocked) == 0:
            return
        self.summary["status"] = "unreachable" if len(far) else "limits"
        self.summary["first_point"] = int(min(np.r_[far[:1], blocked[:1]]))
        which = "" if self.branch is None else f" on branch {_signs(self.branch)}"
        reasons = []
        for points, what in (
            (far, "out of reach"),
            (blocked, f"reachable only outside the joint limits{which}"),
        ):
            if len(points):
                first = int(points[0])
                place = ", ".join(f"{x:.4f}" for x in poses[first, :3, 3])
                verb = "is" if len(points) == 1 else "are"
                reason = (
                    f"{len(points)} of {total} points {verb} {what}, the first is point {first} ({place})"
                )
                why = arm.self_motion(poses[first]).reason
                reasons.append(f"{reason}: {why}" if why else reason)
        raise CannotFollowError("; ".join(reasons))

    def _plan(self, arm: rd.SrsArm, path: rd.Path, progress: Progress) -> rd.SwivelPlan:
        task = progress.add_task("planning", total=len(path))

        def report(share: float) -> None:
            progress.update(task, completed=round(share * len(path)))

        if self.way.plan == "flow":
            plan = self._flow(arm, path, report)
        else:
            plan = rd.plan_swivel(
                arm,
                path,
                self.way.scene,
                self.way.cyclic,
                self.way.desired,
                fixed=self.swivel,
                branch=self.branch,
                wanted_clearance=self.way.clearance,
                link_radius=self.way.link_radius,
                links=self.way.links,
                progress=report,
            )
        self.summary["status"] = str(plan.status)
        self.summary["events"] = [
            {"kind": str(e.kind), "index": e.index, "t": e.t, "s": e.s, "message": e.message}
            for e in plan.events
        ]
        if plan.status != rd.Status.CONVERGED:
            self.summary["first_point"] = _first_fault(plan, len(path))
            raise CannotFollowError(plan.reason)
        return plan

    def _flow(self, arm: rd.SrsArm, path: rd.Path, report: Any) -> rd.SwivelPlan:
        """Step by step along the points of the path, from the best start."""
        start = rd.plan_swivel(
            arm,
            rd.Path(path.poses[:2]),
            self.way.scene,
            desired=self.way.desired,
            fixed=self.swivel,
            branch=self.branch,
            wanted_clearance=self.way.clearance,
            link_radius=self.way.link_radius,
            links=self.way.links,
        )
        if start.status != rd.Status.CONVERGED or path.t is None:
            self.summary |= {"status": str(start.status), "events": [], "first_point": 0}
            raise CannotFollowError(start.reason)
        s0 = float(start.swivel[0])
        wanted = next((s for s in (self.swivel, self.way.desired) if s is not None), s0)
        first, second, third = (int(sign) for sign in start.branch[0])
        flow = rd.SwivelFlow(
            arm,
            wanted,
            self.way.scene,
            link_radius=self.way.link_radius,
            links=self.way.links,
            branch=(first, second, third),
        )
        steps = np.diff(path.t)
        if not np.allclose(steps, steps[0], rtol=1e-6):
            raise rd.RedundancyError(f"{self.path_file}: --plan flow needs evenly spaced times")
        return flow.follow(path, s0, float(path.t[-1] - path.t[0]) / (len(path) - 1), progress=report)

    def _animate(self, chain: rd.Chain, plan: rd.SwivelPlan, motion: rd.Trajectory, scene: rd.Scene) -> None:
        """Where the joints and the tool are in space, row by row, and what is around them."""
        names = [name for name in chain.link_names if name]
        points = np.stack([chain.forward(plan.q, link=name)[:, :3, 3] for name in names], axis=1)
        points = np.concatenate([points, chain.forward(plan.q)[:, None, :3, 3]], axis=1)
        animation = {
            "robot": chain.name,
            "t": motion.t.tolist(),
            "points": [*names, "tool"],
            "positions_m": np.round(points, 6).tolist(),
            "link_radius_m": self.way.link_radius,
            "joint_names": list(chain.joint_names),
            "q": np.round(plan.q, 9).tolist(),
            "clearance_m": None if plan.clearance is None else np.round(plan.clearance, 6).tolist(),
            "obstacles": json.loads(scene.to_json())["obstacles"],
        }
        (self.out / "animation.json").write_text(json.dumps(animation, allow_nan=False) + "\n")

    def _give_up(self, arm: rd.SrsArm, path: rd.Path, reason: str) -> None:
        """Leave behind why, and the band in which the swivel would have had to run."""
        self.summary["reason"] = reason
        self._write_summary()
        if not self.plots:
            return
        shown = _shown(len(path))
        poses = path.poses[shown]
        choices = [self.branch] if self.branch else [_branch_of(index) for index in range(8)]
        bands = [plot.swivel_band(arm, poses, signs) for signs in choices]
        band = max(bands, key=lambda b: int(b.any(axis=1).sum()))
        marks = [(float(path.s[self.summary["first_point"]]), "first point that fails")]
        figure = plot.swivel(path.s[shown], None, band, marks)
        _save(figure, self.out / "swivel.png")

    def _measure(
        self,
        chain: rd.Chain,
        path: rd.Path,
        plan: rd.SwivelPlan,
        motion: rd.Trajectory,
        progress: Progress,
    ) -> None:
        """What the result is worth, from the returned joint positions alone."""
        q, qd, poses = motion.q, motion.qd, path.poses
        task = progress.add_task("measuring", total=len(q))
        position = orientation = 0.0
        for first in range(0, len(q), _CHUNK):
            made, wanted = chain.forward(q[first : first + _CHUNK]), poses[first : first + _CHUNK]
            position = max(position, float(np.abs(made - wanted)[:, :3, 3].max()))
            # |A - B| = 2 sqrt(2) sin(angle / 2)
            chord = np.linalg.norm((made - wanted)[:, :3, :3], axis=(1, 2)).max() / np.sqrt(8)
            orientation = max(orientation, 2 * float(np.arcsin(min(1.0, chord))))
            progress.update(task, advance=len(wanted))
        room = np.minimum(q - chain.lower, chain.upper - q)
        row, joint = np.unravel_index(np.argmin(room), room.shape)
        use = np.abs(qd) / chain.velocity_limit
        fast_row, fast_joint = np.unravel_index(np.argmax(use), use.shape)
        names = chain.joint_names
        self.summary |= {
            "duration_s": float(motion.t[-1] - motion.t[0]),
            "branch": _signs(plan.branch[0]),
            "swivel_range_rad": [float(np.min(plan.swivel)), float(np.max(plan.swivel))],
            "position_error_m": position,
            "orientation_error_rad": orientation,
            "limit_margin_rad": float(room[row, joint]),
            "limit_margin_at": {"joint": names[joint], "point": int(row)},
            "velocity_use": float(use[fast_row, fast_joint]),
            "velocity_use_at": {"joint": names[fast_joint], "point": int(fast_row)},
            "largest_joint_step_rad": float(np.abs(np.diff(q, axis=0)).max(initial=0.0)),
        }
        if plan.clearance is not None:
            nearest = int(np.argmin(plan.clearance))
            self.summary |= {
                "clearance_m": float(plan.clearance[nearest]),
                "clearance_at": {"point": nearest},
            }
        if plan.self_clearance is not None:
            nearest = int(np.argmin(plan.self_clearance))
            self.summary |= {
                "self_clearance_m": float(plan.self_clearance[nearest]),
                "self_clearance_at": {"point": nearest},
            }

    def _draw(self, arm: rd.SrsArm, path: rd.Path, plan: rd.SwivelPlan, motion: rd.Trajectory) -> None:
        shown = _shown(len(path))
        band = plot.swivel_band(arm, path.poses[shown], plan.branch[0])
        title = (
            f"{arm.chain.name}: {len(path)} points, {path.length:.2f} m, {self.summary['duration_s']:.1f} s"
        )
        angles = np.asarray(plan.swivel)[shown]
        _save(plot.track(motion, arm.chain, path.s[shown], angles, band, title), self.out / "track.png")

    def _write_summary(self) -> None:
        text = json.dumps(self.summary, indent=2, allow_nan=False)
        (self.out / "summary.json").write_text(text + "\n")

    def _report(self, written: list[str]) -> None:
        s = self.summary
        low, high = np.rad2deg(s["swivel_range_rad"])
        turns = 360.0 * round((low + high) / 720.0)
        low, high = low - turns, high - turns
        lines = [
            f"[bold]{escape(s['robot'])}[/] follows {escape(s['path'])}: "
            f"{s['points']} points, {s['length_m']:.3f} m, {s['duration_s']:.2f} s",
            f"branch {s['branch']}, swivel {low:.1f} to {high:.1f} deg, "
            f"largest joint step {np.rad2deg(s['largest_joint_step_rad']):.2f} deg",
            f"closest to a limit: {np.rad2deg(s['limit_margin_rad']):.1f} deg "
            f"({escape(s['limit_margin_at']['joint'])} at point {s['limit_margin_at']['point']})",
            f"fastest: {100 * s['velocity_use']:.0f} % of the limit of {escape(s['velocity_use_at']['joint'])}",
            f"pose error by forward kinematics: {s['position_error_m']:.1e} m, {s['orientation_error_rad']:.1e} rad",
        ]
        if "clearance_m" in s:
            lines.append(
                f"nearest to an obstacle: {1e3 * s['clearance_m']:.1f} mm at point {s['clearance_at']['point']}"
            )
        if "self_clearance_m" in s:
            nearest, point = s["self_clearance_m"], s["self_clearance_at"]["point"]
            lines.append(f"nearest to itself: {1e3 * nearest:.1f} mm at point {point}")
        lines += [escape(line) for line in _motion.lines(s["timing"])]
        lines.append(f"in {escape(str(self.out))}: {', '.join(written)}")
        for line in lines:
            _out.print(line, soft_wrap=True)


def load_robot(robot: str, base: str | None, tip: str | None) -> rd.Chain:
    """A catalogue arm by name, or the arm in a URDF file."""
    file = File(robot)
    if robot in rd.catalog.names():
        if base or tip:
            raise rd.RedundancyError(f"--base and --tip belong to URDF files, '{robot}' is in the catalogue")
        return rd.catalog.load(robot)
    if file.is_file():
        return rd.Chain.from_urdf(robot, base, tip)
    if file.suffix in {".urdf", ".xml"} or file.parent != File():
        raise rd.RedundancyError(f"robot file '{robot}' does not exist")
    names = ", ".join(rd.catalog.names())
    raise rd.RedundancyError(f"unknown robot '{robot}', expected one of: {names}, or a URDF file")


def _swivel(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        degrees = float(text)
    except ValueError:
        degrees = np.nan
    if not np.isfinite(degrees):
        raise rd.RedundancyError(f"--swivel is '{text}', it must be auto or an angle in degrees")
    return float(np.deg2rad(degrees))


def _branch(text: str) -> tuple[int, int, int] | None:
    if text == "auto":
        return None
    signs = tuple({"+": 1, "-": -1}.get(sign, 0) for sign in text)
    if len(signs) != 3 or 0 in signs:
        raise rd.RedundancyError(f"--branch is '{text}', it must be auto or three signs such as +++ or +-+")
    return signs[0], signs[1], signs[2]


def _branch_index(signs: tuple[int, int, int]) -> int:
    return sum(weight for weight, sign in zip((4, 2, 1), signs, strict=True) if sign < 0)


def _branch_of(index: int) -> tuple[int, int, int]:
    first, second, third = (-1 if index & weight else 1 for weight in (4, 2, 1))
    return first, second, third


def _signs(branch: Any) -> str:
    return "".join("+" if sign > 0 else "-" for sign in branch)


def _shown(total: int) -> NDArray[np.int64]:
    """Indices of the points that a plot shows, both ends included."""
    return np.unique(np.linspace(0, total - 1, min(total, _PLOTTED)).round().astype(np.int64))


def _save(figure: Any, file: File) -> None:
    figure.savefig(file, dpi=110)


def _progress(points: int) -> AbstractContextManager[Progress]:
    """A bar on long paths, where someone is watching."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=_err, transient=True, disable=points < _LONG or not _err.is_terminal)


# --- analyse ----------------------------------------------------------------------------------------------


@app.command()
def analyse(
    robot: Annotated[str, typer.Option(help="Name from `redundancy robots`, or a URDF file.")],
    out: Annotated[File, typer.Option(help="Folder for the results; created if needed.")] = File(
        "redundancy-analysis"
    ),
    path: Annotated[
        File | None,
        typer.Option(help="CSV of the path to follow; by default, for planar3r, the circle of [Park1996]."),
    ] = None,
    q: Annotated[
        str | None,
        typer.Option(help="Joint angles in degrees; the pose of the tool at these angles is analysed."),
    ] = None,
    criterion: Annotated[str, typer.Option(help="manipulability or joint_range.")] = "manipulability",
    task: Annotated[
        str | None,
        typer.Option(help="Coordinates that are kept; by default planar for planar arms, otherwise pose."),
    ] = None,
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    plots: Annotated[bool, typer.Option(help="Whether to draw the PNGs.")] = True,
) -> None:
    """Find every optimum of a criterion for a pose, and how far each can be followed along a path.

    Writes summary.json (critical points, their kinds, where and why each path
    stops), the trajectory of the best start, and PNGs.
    Exit status: 0 done, 1 no start completes the path, 2 bad input.

    Example:  redundancy analyse --robot planar3r --out analysis/
    Example:  redundancy analyse --robot iiwa14 --q "20,40,0,-80,0,60,0" --criterion joint_range --out analysis/
    """
    from redundancy._analyse import Analysis  # noqa: PLC0415 - the other commands do without it

    chain = load_robot(robot, base, tip)
    if task is None:
        task = "planar" if chain.name.startswith("planar") else "pose"
    angles = None if q is None else _angles(q, chain)
    analysis = Analysis(chain, robot, out, criterion, task, path, angles, plots)
    try:
        lines, written = analysis.run()
    except KeyboardInterrupt as error:
        raise StoppedError from error
    for line in lines:
        _out.print(escape(line), soft_wrap=True)
    _out.print(f"in {escape(str(out))}: {', '.join(written)}", soft_wrap=True)
    if analysis.summary["completed"] is False:
        raise CannotFollowError("every critical point for the start of the path ends at a singularity")


def _angles(text: str, chain: rd.Chain) -> NDArray[np.float64]:
    try:
        degrees = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        degrees = []
    if len(degrees) != chain.dof or not np.isfinite(degrees).all():
        raise rd.RedundancyError(f"--q is '{text}', it must be {chain.dof} angles in degrees")
    return np.deg2rad(degrees)


# --- paint ------------------------------------------------------------------------------------------------


@app.command()
def paint(
    robot: Annotated[str, typer.Option(help="Name from `redundancy robots`, or a URDF file.")],
    path: Annotated[File, typer.Option(help="CSV: x,y,z (m), and qw,qx,qy,qz unless the tool points down.")],
    out: Annotated[File, typer.Option(help="Folder for the results; created if needed.")],
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    tool: Annotated[
        str, typer.Option(help="Position x,y,z of the gun's tip in the frame of the last link, m.")
    ] = "0,0,0",
    rule: Annotated[
        str, typer.Option(help=f"all, or comma-separated names: {', '.join(_painting.RULES)}.")
    ] = "all",
    plan: Annotated[bool, typer.Option("--plan", help="Plan tilt and spin along the whole path.")] = False,
    half_angle: Annotated[
        float, typer.Option(help="Largest tilt of the plan and of the barrier rules, degrees.")
    ] = 20.0,
    angle: Annotated[float, typer.Option(help="Largest tilt of the tilt rules, degrees.")] = 10.0,
    spin: Annotated[
        str, typer.Option(help="Spin of the plan: free, or the largest angle in degrees.")
    ] = "free",
    torque_limits: Annotated[str, typer.Option(help="chain, off, or comma-separated N m.")] = "chain",
    torque_margin: Annotated[
        float, typer.Option(help="Part of the torque limits kept in reserve, percent.")
    ] = 0.0,
    velocity_limits: Annotated[str, typer.Option(help="chain, off, or comma-separated deg/s.")] = "chain",
    joint_limits: Annotated[bool, typer.Option(help="Whether the position limits are imposed.")] = True,
    max_rate: Annotated[
        float | None, typer.Option(help="Plan: largest rate of rotation of the tool, deg/s.")
    ] = None,
    time_limit: Annotated[
        float, typer.Option(help="Plan: seconds after which the best plan so far is used.")
    ] = 60.0,
    plots: Annotated[bool, typer.Option(help="Whether to draw the PNGs and the report.")] = True,
) -> None:
    """Find how fast a gun can paint: with constant orientation, with the rules of the papers, with a plan.

    Prints the largest constant speed of each, and writes the fastest motion
    (with --plan, that of the plan): trajectory.csv, trajectory.json,
    summary.json, PNGs, and report.html, which needs no network. The tool speed
    is constant along the path; a lead-in and a lead-out, marked as sections,
    begin and end at rest.
    Exit status: 0 done, 1 the path cannot be followed, 2 bad input.

    Example:  redundancy paint --robot puma560 --tool -0.15,0,0.4 --path path.csv --out run/
    Example:  redundancy paint --robot puma560 --tool -0.15,0,0.4 --path path.csv --plan --half-angle 20 --out run/
    """
    chain = load_robot(robot, base, tip)
    pose = np.eye(4)
    pose[:3, 3] = _numbers(tool, "--tool", 3)
    joints = chain.dof
    torques: Any = torque_limits if torque_limits == "chain" else None
    if torque_limits not in {"chain", "off"}:
        torques = _numbers(torque_limits, "--torque-limits", joints)
    speeds: Any = velocity_limits if velocity_limits == "chain" else None
    if velocity_limits not in {"chain", "off"}:
        speeds = np.deg2rad(_numbers(velocity_limits, "--velocity-limits", joints))
    if not 0.0 <= torque_margin < 100.0:
        raise rd.RedundancyError(f"--torque-margin is {torque_margin}, it must be in [0, 100) percent")
    paint_job(
        _painting.Job(
            chain.with_tool(pose) if tool != "0,0,0" else chain,
            robot,
            path,
            out,
            _rules(rule),
            float(np.deg2rad(angle)),
            float(np.deg2rad(half_angle)),
            "free" if spin == "free" else float(np.deg2rad(_numbers(spin, "--spin", 1)[0])),
            plan,
            torques,
            torque_margin / 100.0,
            speeds,
            joint_limits,
            None if max_rate is None else float(np.deg2rad(max_rate)),
            time_limit,
            plots,
        )
    )


def paint_job(job: _painting.Job) -> None:
    """Run one job of `paint`, with a bar while it plans, and print its table."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=_err, transient=True, disable=not (job.plan and _err.is_terminal))
    with bar as progress:
        task = progress.add_task("planning", total=1.0)

        def show(share: float, speed: float) -> None:
            progress.update(task, completed=share, description=f"planning, {speed:.3f} m/s")

        job.progress = show
        try:
            written = job.run()
        except KeyboardInterrupt as error:
            raise StoppedError from error
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in _painting.HEADER:
        table.add_column(
            title, overflow="fold", justify="right" if title in {"speed (m/s)", "gain"} else "left"
        )
    for choice in job.choices:
        table.add_row(*(escape(cell) for cell in _painting.cells(choice)))
    console = _out if _out.is_terminal else Console(width=160, highlight=False)
    console.print(table)
    _out.print(f"in {escape(str(job.out))}: {', '.join(written)}", soft_wrap=True)


def _rules(text: str) -> tuple[str, ...]:
    if text == "all":
        return _painting.RULES
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in _painting.RULES:
            raise rd.RedundancyError(
                f"--rule has '{name}', expected all or some of: {', '.join(_painting.RULES)}"
            )
    # The gain is over a constant orientation, so that is measured first, always.
    return ("constant", *(name for name in names if name != "constant"))


def _numbers(text: str, option: str, count: int) -> NDArray[np.float64]:
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise rd.RedundancyError(f"{option} is '{text}', it must be {count} comma-separated numbers")
    return values


# --- plan -------------------------------------------------------------------------------------------------


@app.command()
def plan(
    robot: Annotated[str, typer.Option(help="Name from `redundancy robots`, or a URDF file.")],
    path: Annotated[
        File, typer.Option(help="CSV: x,y,z (m), qw,qx,qy,qz or positions only, t (s) or s (m).")
    ],
    out: Annotated[File, typer.Option(help="Folder for the results; created if needed.")],
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    tool: Annotated[str, typer.Option(help="Tool centre point x,y,z in the frame of the tip, m.")] = "0,0,0",
    rail: Annotated[
        str | None, typer.Option(help="Rail before the base: direction and range, x,y,z,lower,upper (m).")
    ] = None,
    half_angle: Annotated[float, typer.Option(help="How far the tool may tilt, degrees.")] = 0.0,
    spin: Annotated[
        str, typer.Option(help="How far the tool may spin: free, or degrees to either side.")
    ] = "0",
    axis: Annotated[str, typer.Option(help="Tool axis in the tool frame: x,y,z.")] = "0,0,1",
    task: Annotated[
        str | None,
        typer.Option(help="Instead of tilt and spin: pose, position, pointing, planar, planar_pose."),
    ] = None,
    obstacles: SceneOption = None,
    collision: CollisionOption = "capsules",
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    clearance: Annotated[float, typer.Option(help="Wanted distance from the obstacles, m.")] = 0.03,
    link_radius: Annotated[float, typer.Option(help="Radius of the links as capsules, m.")] = 0.05,
    cyclic: Annotated[
        bool, typer.Option(help="End in the configuration of the start; the path must be closed.")
    ] = False,
    objective: Annotated[
        str, typer.Option(help="What is minimised: motion, length or peak_speed.")
    ] = "motion",
    motion_weight: Annotated[float | None, typer.Option(help="Weight of the joint motion.")] = None,
    limit_weight: Annotated[
        float | None, typer.Option(help="Weight of staying away from the joint limits.")
    ] = None,
    joint_weights: Annotated[
        str | None, typer.Option(help="Weight of the motion of each joint, comma-separated.")
    ] = None,
    q_start: Annotated[str | None, typer.Option(help="Joints at the first point, rad or m.")] = None,
    q_end: Annotated[str | None, typer.Option(help="Joints at the last point, rad or m.")] = None,
    tool_speed: Annotated[float | None, typer.Option(help="Constant speed of the tool, m/s.")] = None,
    velocity_limits: Annotated[str, typer.Option(help="chain, off, or comma-separated deg/s.")] = "chain",
    margin: Annotated[float, typer.Option(help="Distance kept from the joint limits, degrees.")] = 0.0,
    time_limit: Annotated[
        float, typer.Option(help="Seconds after which the best plan so far is used.")
    ] = 10.0,
    seed: Annotated[int, typer.Option(help="Seed of the random postures.")] = 0,
    threads: Annotated[int | None, typer.Option(help="Threads; all cores by default.")] = None,
    retime: Annotated[
        bool,
        typer.Option(
            "--retime",
            help="Replace the path's own times by the fastest ones within the limits; those of jerk are assumed.",
        ),
    ] = False,
    plots: Annotated[bool, typer.Option(help="Whether to draw the PNGs.")] = True,
) -> None:
    """Plan a whole path for any arm, with any freedom of the tool.

    Writes trajectory.csv, trajectory.json, plan.npz, summary.json and PNGs.
    The trajectory files hold the motion to run; plan.npz holds the plan with the times of its path, or its own.
    Ctrl-C keeps the best plan so far. Times of the path (or of --tool-speed)
    are kept, and limits that they violate are reported; without them the motion
    goes from rest to rest as fast as the limits allow.
    Exit status: 0 done, 1 the path cannot be followed, 2 bad input.

    Example:  redundancy plan --robot panda --path path.csv --out run/
    Example:  redundancy plan --robot ur5.urdf --base base_link --tip tool0 --path path.csv --spin free --out run/
    Example:  redundancy plan --robot panda --path path.csv --scene scene.json --out run/
    """
    bodies = bodies_of(collision, srdf, package_dir)
    chain = with_tool(load_robot(robot, base, tip), tool)
    if rail is not None:
        chain = _plan.on_rail(chain, rail)
    joints = chain.dof

    def given(text: str | None, option: str) -> NDArray[np.float64] | None:
        return None if text is None else _plan.vector(text, option, joints)

    limits: Any = velocity_limits if velocity_limits == "chain" else None
    if velocity_limits not in {"chain", "off"}:
        limits = np.deg2rad(_plan.vector(velocity_limits, "--velocity-limits", joints))
    options: dict[str, Any] = {
        "freedom": rd.ToolFreedom(
            np.deg2rad(half_angle), _plan.spin_of(spin), tuple(_plan.vector(axis, "--axis", 3))
        ),
        "task": task,
        "cyclic": cyclic,
        "objective": objective,
        "joint_weights": given(joint_weights, "--joint-weights"),
        "q_start": given(q_start, "--q-start"),
        "q_end": given(q_end, "--q-end"),
        "tool_speed": tool_speed,
        "velocity_limits": limits,
        "margin": float(np.deg2rad(margin)),
        "wanted_clearance": clearance,
        "link_radius": link_radius,
        "time_limit": time_limit,
        "seed": seed,
        "threads": threads,
    }
    if collision != "none":
        if obstacles is not None:
            options["scene"] = rd.Scene.from_json(obstacles)
        options["links"] = bodies.links(robot, chain)
    weights = {"motion_weight": motion_weight, "limit_weight": limit_weight}
    options |= {name: value for name, value in weights.items() if value is not None}
    plan_job(_plan.Job(chain, robot, path, rd.Path.from_csv(path), out, options, plots, retime=retime))


def plan_job(job: _plan.Job) -> None:
    """Run one job of `plan`, with a bar while it plans, and print what came out."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=_err, transient=True, disable=not _err.is_terminal) as progress:
        task = progress.add_task("planning", total=1.0)

        def show(share: float) -> None:
            progress.update(task, completed=share)

        job.progress = show
        written = job.run()
    if job.plan is None:
        return
    table = Table(box=None, pad_edge=False, show_header=False)
    for name, value in _plan.rows(job.chain, job.plan, job.motion or job.plan):
        table.add_row(name, escape(value))
    for line in _motion.lines(job.summary.get("timing", {})):
        table.add_row("times", escape(line))
    console = _out if _out.is_terminal else Console(width=160, highlight=False)
    console.print(table)
    _out.print(f"in {escape(str(job.out))}: {', '.join(written)}", soft_wrap=True)
    if not job.plan.legal:
        raise CannotFollowError(job.plan.reason or str(job.plan.status))


# --- explore ----------------------------------------------------------------------------------------------


@app.command()
def explore(
    robot: Annotated[
        str | None,
        typer.Option(help="Name from `redundancy robots`, or a URDF file; by default the arm of --map."),
    ] = None,
    path: Annotated[File | None, typer.Option(help="CSV of a path, as for `redundancy plan`.")] = None,
    plan: Annotated[
        list[File] | None,
        typer.Option(help="plan.npz of `redundancy plan`; given twice, both are shown side by side."),
    ] = None,
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    tool: Annotated[str, typer.Option(help="Tool centre point x,y,z in the frame of the tip, m.")] = "0,0,0",
    half_angle: Annotated[float, typer.Option(help="How far the tool may tilt, degrees.")] = 0.0,
    spin: Annotated[
        str, typer.Option(help="How far the tool may spin: free, or degrees to either side.")
    ] = "0",
    obstacles: SceneOption = None,
    collision: CollisionOption = "capsules",
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    capability: Annotated[
        File | None, typer.Option("--map", help="Folder of `redundancy map`: slices of it are shown.")
    ] = None,
    port: Annotated[
        int,
        typer.Option(
            help="Port of the page; the next free one if it is in use, 0 for any.", min=0, max=65535
        ),
    ] = 8080,
    host: Annotated[
        str, typer.Option(help="Address to listen on; by default only this machine can open the page.")
    ] = "127.0.0.1",
    open_browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Whether to open it.")] = True,
) -> None:
    """Show an arm, its freedom, plans and obstacles in the browser, until Ctrl-C.

    Needs the extra `explorer`. Nothing outside of this machine is contacted.

    Example:  redundancy explore --robot panda
    Example:  redundancy explore --robot panda --path path.csv --plan run/plan.npz --scene scene.json
    Example:  redundancy explore --map iiwa.zarr
    """
    found = None if capability is None else rd.maps.open(capability)
    if robot is not None:
        chain = with_tool(load_robot(robot, base, tip), tool)
    elif found is not None:
        chain = with_tool(found.chain, tool)
    else:
        raise rd.RedundancyError("give --robot, or --map with a folder of `redundancy map`")
    bodies = bodies_of(collision, srdf, package_dir)
    turning = _plan.spin_of(spin)
    freedom = None
    if half_angle != 0.0 or turning != 0.0:
        freedom = rd.ToolFreedom(np.deg2rad(half_angle), turning)
    try:
        view = rd.explore(
            chain,
            None if path is None else rd.Path.from_csv(path),
            [rd.Plan.from_npz(file) for file in plan or []],
            None if obstacles is None or collision == "none" else rd.Scene.from_json(obstacles),
            None if robot is None else bodies.links(robot, chain),
            port,
            open_browser,
            host=host,
            freedom=freedom,
            capability=found,
        )
    except ValueError as error:  # a plan or a map of another arm
        raise rd.RedundancyError(str(error)) from error
    except ImportError as error:
        raise rd.RedundancyError(str(error)) from error
    try:
        _out.print(f"{view.url}  (Ctrl-C to stop)", soft_wrap=True)
        view.wait()
    except KeyboardInterrupt:
        pass
    finally:
        view.close()


# --- check ------------------------------------------------------------------------------------------------


@app.command()
def check(
    trajectory: Annotated[File, typer.Argument(help="JSON (ROS JointTrajectory), CSV or npz file.")],
    robot: Annotated[str, typer.Option(help="Name from `redundancy robots`, or a URDF file.")],
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    path: Annotated[File | None, typer.Option(help="CSV of the path that the tool should follow.")] = None,
    scene: SceneOption = None,
    collision: CollisionOption = "capsules",
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    format_: Annotated[str, typer.Option("--format", help="text, json or github.")] = "text",
    tool: Annotated[
        str, typer.Option(help="Position x,y,z of the tool in the frame of the last link, m.")
    ] = "0,0,0",
    velocity_limits: Annotated[
        str, typer.Option(help="chain, off, or deg/s: one, or comma-separated.")
    ] = "chain",
    acceleration_limits: Annotated[
        str, typer.Option(help="chain, off, or deg/s^2: one, or comma-separated.")
    ] = "chain",
    jerk_limits: Annotated[str, typer.Option(help="off, or deg/s^3: one, or comma-separated.")] = "off",
    torque_limits: Annotated[str, typer.Option(help="chain, off, or N m: one, or comma-separated.")] = "off",
    rest: Annotated[bool, typer.Option(help="Whether the trajectory must start and end at rest.")] = True,
    tolerance: Annotated[
        float | None, typer.Option(help="Fraction of a limit by which it may be exceeded.")
    ] = None,
    position_tolerance: Annotated[
        float | None, typer.Option(help="Largest allowed distance from the path, m.")
    ] = None,
    orientation_tolerance: Annotated[
        str | None, typer.Option(help="Largest allowed angle from the path's orientation, degrees, or off.")
    ] = None,
    clearance: Annotated[float, typer.Option(help="Required distance from obstacles, m.")] = 0.0,
    link_radius: Annotated[float, typer.Option(help="Radius of the links as capsules, m.")] = 0.05,
) -> None:
    """Check a joint trajectory before an arm runs it: limits, jumps, rest, contact, deviation from a path.

    Exit status: 0 no error, 1 errors, 2 bad input, such as times that do not increase.

    Example:  redundancy check trajectory.json --robot panda
    Example:  redundancy check move.csv --robot arm.urdf --path path.csv --scene scene.json --format github
    Example:  redundancy check move.csv --robot arm.urdf --scene scene.json --collision urdf --package-dir share/
    Example:  redundancy check move.csv --robot arm.urdf --collision urdf --srdf arm.srdf --package-dir share/
    """
    if format_ not in _check.FORMATS:
        raise rd.RedundancyError(f"--format is '{format_}', it must be text, json or github")
    chain = with_tool(load_robot(robot, base, tip), tool)

    def limits(text: str, option: str, in_degrees: bool = True) -> Any:
        if text in {"chain", "off"}:
            return "chain" if text == "chain" else None
        values = _plan.per_joint(text, option, chain.dof)
        return np.deg2rad(values) if in_degrees else values

    options: dict[str, Any] = {
        "velocity_limits": limits(velocity_limits, "--velocity-limits"),
        "acceleration_limits": limits(acceleration_limits, "--acceleration-limits"),
        "torque_limits": limits(torque_limits, "--torque-limits", in_degrees=False),
        "at_rest": rest,
        "tolerance": tolerance,
        "position_tolerance": position_tolerance,
        "clearance": clearance,
    }
    if jerk_limits != "off":
        options["jerk_limits"] = np.deg2rad(_plan.per_joint(jerk_limits, "--jerk-limits", chain.dof))
    if orientation_tolerance is not None:
        angle = None
        if orientation_tolerance != "off":
            angle = float(np.deg2rad(_plan.vector(orientation_tolerance, "--orientation-tolerance", 1)[0]))
        options["orientation_tolerance"] = angle
    bodies = bodies_of(collision, srdf, package_dir)
    if collision != "none":
        links = bodies.links(robot, chain)
        options["links"] = link_radius if links is None else links
    job = _check.Job(chain, robot, trajectory, path, None if collision == "none" else scene, options)
    report = job.run()
    text = getattr(job, format_)(report)
    if text:
        # As it is: no wrapping, no colours, whatever the terminal.
        sys.stdout.write(text + "\n")
    if not report.judged:
        raise rd.RedundancyError(f"{trajectory}: {report.findings[0].message}")
    if not report.ok:
        raise typer.Exit(CANNOT_FOLLOW)


def with_tool(chain: rd.Chain, tool: str) -> rd.Chain:
    """The chain with a tool of which only the position is given."""
    if tool == "0,0,0":
        return chain
    pose = np.eye(4)
    pose[:3, 3] = _plan.vector(tool, "--tool", 3)
    return chain.with_tool(pose)


# --- map, place -------------------------------------------------------------------------------------------

SchedulerOption = Annotated[
    str | None,
    typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786; without it this process."),
]
FreedomOption = Annotated[float, typer.Option(help="Largest tilt of the tool axis, degrees.")]
SpinOption = Annotated[str, typer.Option(help="Largest spin about the tool axis, degrees, or free.")]


def _freedom(tilt: float, spin: str) -> rd.ToolFreedom | None:
    if tilt == 0.0 and spin == "0":
        return None
    if spin == "free":
        return rd.ToolFreedom(half_angle=float(np.deg2rad(tilt)), spin="free")
    angle = float(np.deg2rad(_numbers(spin, "--spin", 1)[0]))
    return rd.ToolFreedom(half_angle=float(np.deg2rad(tilt)), spin=angle)


def _region(text: str, option: str, counts: tuple[int, ...]) -> list[list[float]]:
    try:
        values = [[float(part) for part in pair.split(":")] for pair in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or any(len(pair) != 2 for pair in values):
        raise rd.RedundancyError(f"{option} is '{text}', expected ranges such as -0.5:0.5,-0.5:0.5 in m")
    return values


@app.command("map")
def map_(
    robot: Annotated[str, typer.Argument(help="Name from `redundancy robots`, or a URDF file.")],
    out: Annotated[File, typer.Option(help="Folder of the store; one that is not done goes on.")] = File(
        "map.zarr"
    ),
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    spacing: Annotated[float, typer.Option(help="Distance of neighbouring positions, m.")] = 0.05,
    directions: Annotated[int, typer.Option(help="Directions of the tool at each position.")] = 50,
    spins: Annotated[int, typer.Option(help="Spins about each direction.")] = 1,
    tilt: FreedomOption = 0.0,
    spin: SpinOption = "0",
    metrics: Annotated[
        str,
        typer.Option(
            help="Comma-separated: reachable, margin, proven, swivel_measure, manipulability, spin_share."
        ),
    ] = "reachable,margin,swivel_measure,manipulability",
    region: Annotated[
        str | None, typer.Option(help="x0:x1,y0:y1,z0:z1 in m, instead of all the reach.")
    ] = None,
    scheduler: SchedulerOption = None,
    verify: Annotated[bool, typer.Option(help="Compare what is done with its checksums first.")] = False,
    show: Annotated[bool, typer.Option(help="Print a slice through the middle of the map.")] = False,
) -> None:
    """Map what an arm can do over all positions and directions of its tool. Needs the extra `maps`.

    Example:  redundancy map iiwa14 --spacing 0.1 --out iiwa.zarr --show
    Example:  redundancy map arm.urdf --scheduler tcp://node1:8786 --out /shared/arm.zarr
    """
    from redundancy.maps._dask import connect  # noqa: PLC0415 - an extra

    job = rd.maps.capability(
        load_robot(robot, base, tip),
        out=out,
        spacing=spacing,
        directions=directions,
        spins=spins,
        freedom=_freedom(tilt, spin),
        metrics=metrics.split(","),
        region=None if region is None else _region(region, "--region", (3,)),
        client=None if scheduler is None else connect(scheduler),
        verify=verify,
        progress="bar" if _err.is_terminal else None,
    )
    found = job.open()
    _out.print(
        f"{escape(str(job.path))}: {job.computed} chunks computed, {job.kept} kept, {job.chunks} in all; "
        f"{job.poses} poses in {job.seconds:.1f} s, {job.rate:,.0f} poses/s",
        soft_wrap=True,
    )
    if "reachable" in found.metrics:
        _out.print(f"reached within the limits: {100 * found.reach_share:.2f} % of all poses")
    if show:
        _show_slice(found)
    if job.status is not rd.Status.CONVERGED:
        raise StoppedError


def _show_slice(found: Any) -> None:
    """The share of reached directions in the middle plane across y, one digit for each tenth."""
    metric = "reachable" if "reachable" in found.metrics else found.metrics[0]
    share = found.share(metric)
    middle = share[:, share.shape[1] // 2, :]
    most = max(float(middle.max()), 1e-12)
    for row in middle.T[::-1]:
        _out.print("".join("." if v <= 0 else str(min(9, int(10 * v / most))) for v in row), markup=False)
    _out.print(
        f"all slices in the browser: redundancy explore --map {escape(str(found.path))}", soft_wrap=True
    )
    _out.print(f"{metric}, plane across y, x to the right, z upwards; 9 is {most:.3f}", markup=False)


@app.command()
def place(
    path: Annotated[File, typer.Argument(help="CSV file: x, y, z, and qw, qx, qy, qz.")],
    robot: Annotated[str, typer.Option(help="Name from `redundancy robots`, or a URDF file.")],
    region: Annotated[str, typer.Option(help="x0:x1,y0:y1 or with z0:z1, shifts of the base in m.")],
    out: Annotated[File, typer.Option(help="Folder of the results; a call that was stopped goes on.")] = File(
        "place.zarr"
    ),
    base: Annotated[str | None, typer.Option(help="URDF only: first link of the arm.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF only: last link of the arm.")] = None,
    spacing: Annotated[float, typer.Option(help="Distance of neighbouring placements, m.")] = 0.1,
    yaw_steps: Annotated[int, typer.Option(help="Turns of the base over a whole turn.")] = 1,
    tilt: FreedomOption = 0.0,
    spin: SpinOption = "0",
    tool_speed: Annotated[float | None, typer.Option(help="Speed of the tool along the path, m/s.")] = None,
    scene: SceneOption = None,
    refine: Annotated[int, typer.Option(help="Halvings of the grid around the best placement.")] = 3,
    scheduler: SchedulerOption = None,
) -> None:
    """Find where the base of an arm should stand for a path. Needs the extra `maps`.

    Exit status: 0 a placement was found, 1 the path cannot be followed from any, 2 bad input.

    Example:  redundancy place path.csv --robot panda --region=-0.3:0.3,-0.3:0.3 --yaw-steps 4
    """
    from redundancy.maps._dask import connect  # noqa: PLC0415 - an extra

    options: dict[str, Any] = {}
    if scene is not None:
        options["scene"] = rd.Scene.from_json(scene)
    if tool_speed is not None:
        options["tool_speed"] = tool_speed
    job = rd.maps.place(
        load_robot(robot, base, tip),
        rd.Path.from_csv(path),
        _region(region, "--region", (2, 3)),
        spacing,
        yaw_steps,
        client=None if scheduler is None else connect(scheduler),
        out=out,
        freedom=_freedom(tilt, spin),
        refine=refine,
        progress="bar" if _err.is_terminal else None,
        **options,
    )
    table = Table(box=None, pad_edge=False)
    for name in ("x", "y", "z", "yaw", "status", "margin", "clearance", "travel", "time"):
        table.add_column(name, justify="right")
    for p in job.placements[:10]:
        x, y, z, yaw = p.xyz_yaw
        cells = [f"{x:.3f}", f"{y:.3f}", f"{z:.3f}", f"{np.rad2deg(yaw):.1f}", str(p.status or "not planned")]
        table.add_row(*cells, *(f"{v:.4f}" for v in (p.margin, p.clearance, p.travel, p.duration)))
    console = _out if _out.is_terminal else Console(width=160, highlight=False)
    console.print(table)
    _out.print(
        f"{len(job.placements)} placements, {job.planned} planned; in {escape(str(out))}", soft_wrap=True
    )
    if job.status is not rd.Status.CONVERGED:
        raise StoppedError
    if not job.best:
        raise CannotFollowError(f"not from any placement; the nearest: {job.placements[0].reason}")


# --- demo -------------------------------------------------------------------------------------------------


@app.command()
def demo(
    out: Annotated[File, typer.Option(help="Folder for the results.")] = File("redundancy-demo"),
    plots: Annotated[bool, typer.Option(help="Whether to draw the PNGs.")] = True,
) -> None:
    """Run seven worked examples of `track`, `plan` and `paint` on built-in paths.

    `track`: a PA10 follows a raster, an iiwa a slanted circle, and the PA10 a
    circle beside a ball. `plan`: a Panda and a UR5e, whose tool may spin
    freely, follow rasters, and an iiwa on a rail a wall. `paint`: a PUMA 560
    with a spray gun. Writes the paths beside the results and prints the command
    of each example.

    Example:  redundancy demo --out demo/
    """
    out.mkdir(parents=True, exist_ok=True)
    urdf = File(__file__).parent / "data" / "kuka_iiwa.urdf"
    # The paths of the iiwa and of the ball have times of their own, at which the arms could not start from rest.
    jobs = (
        ("pa10", "pa10", None, None, demo_raster(), False),
        ("iiwa", str(urdf), "lbr_iiwa_link_0", "lbr_iiwa_link_7", demo_circle(), True),
    )
    for name, robot, base, tip, path, retime in jobs:
        file = out / f"{name}_path.csv"
        path.to_csv(file)
        options = (f" --base {base} --tip {tip}" if base else "") + (" --retime" if retime else "")
        command = f"redundancy track --robot {robot} --path {file}{options} --out {out / name}"
        _out.print(f"[dim]$ {escape(command)}[/]", soft_wrap=True)
        Job(robot, file, out / name, base, tip, plots=plots, retime=retime).run()
        _out.print()
    file, scene = out / "ball_path.csv", out / "ball_scene.json"
    demo_lap().to_csv(file)
    scene.write_text(demo_ball().to_json() + "\n")
    command = f"redundancy track --robot pa10 --path {file} --scene {scene} --cyclic --retime"
    command += f" --out {out / 'ball'}"
    _out.print(f"[dim]$ {escape(command)}[/]", soft_wrap=True)
    Job("pa10", file, out / "ball", plots=plots, way=Way(scene, cyclic=True), retime=True).run()
    _out.print()
    for name, robot, path, choices in demo_plans():
        file = out / f"{name}_path.csv"
        path.to_csv(file)
        words = "".join(f" --{key} {value}" for key, value in choices.items())
        _out.print(
            f"[dim]$ {escape(f'redundancy plan --robot {robot} --path {file}{words} --out {out / name}')}[/]",
            soft_wrap=True,
        )
        chain = rd.catalog.load(robot)
        if "rail" in choices:
            chain = _plan.on_rail(chain, choices["rail"])
        freedom = rd.ToolFreedom(spin=_plan.spin_of(choices.get("spin", "0")))
        plan_job(_plan.Job(chain, robot, file, path, out / name, {"freedom": freedom}, plots))
        _out.print()
    file = out / "paint_path.csv"
    demo_strokes().to_csv(file)
    command = f"redundancy paint --robot puma560 --tool -0.15,0,0.4 --path {file} --plan --time-limit 4"
    command += f" --out {out / 'paint'}"
    _out.print(f"[dim]$ {escape(command)}[/]", soft_wrap=True)
    tool = np.eye(4)
    tool[:3, 3] = (-0.15, 0.0, 0.4)
    gun = rd.catalog.load("puma560").with_tool(tool)
    angles = (float(np.deg2rad(10.0)), float(np.deg2rad(20.0)))
    paint_job(
        _painting.Job(
            gun,
            "puma560",
            file,
            out / "paint",
            _painting.RULES,
            *angles,
            plan=True,
            time_limit=4.0,
            plots=plots,
        )
    )


def demo_plans() -> list[tuple[str, str, rd.Path, dict[str, str]]]:
    """Name, robot, path and options of the plans that the demo makes."""
    down = np.diag([1.0, -1.0, -1.0])
    panda = rd.paths.raster((0.35, -0.25, 0.25), 0.3, 0.08, 5, corner=0.06, orientation=down)
    ur = rd.paths.raster((0.3, -0.25, 0.1), 0.5, 0.08, 4, corner=0.06, orientation=down)
    # Along a wall: the tool looks at it, and the height goes up and down.
    along = np.linspace(-0.5, 2.5, 1000)
    positions = np.column_stack([np.full(1000, 0.6), along, 0.5 + 0.15 * np.sin(2 * np.pi * along)])
    facing = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    wall = rd.Path(positions).with_orientation(facing)
    return [
        ("panda", "panda", panda.resampled(panda.length / 999), {}),
        ("ur", "ur5e", ur.resampled(ur.length / 999), {"spin": "free"}),
        ("rail", "iiwa14", wall, {"rail": "0,1,0,0,2"}),
    ]


def demo_strokes() -> rd.Path:
    """Three strokes for the spray gun: the path REF-B of docs/painting.md."""
    return rd.paths.raster((0.44, -0.25, -0.3), 0.5, 0.21, 3, corner=0.17912615734826384)


def demo_raster() -> rd.Path:
    """Five strokes over a table with the tool leaning inwards: 1 000 points for the PA10."""
    raster = rd.paths.raster((0.45, -0.3, 0.1), 0.6, 0.08, 5, corner=0.06)
    path = raster.resampled(raster.length / 999)
    return path.with_orientation(lambda p: _leaning(p, (0.61, 0.0, 0.1), -1.5))


def demo_circle() -> rd.Path:
    """A slanted circle at 0.1 m/s with the tool leaning inwards: 1 000 points for the iiwa."""
    circle = rd.paths.circle((0.45, 0.0, 0.5), 0.25, normal=(1.0, 0.0, 1.0), n=1000)
    return circle.with_times(circle.s / 0.1).with_orientation(lambda p: _leaning(p, (0.45, 0.0, 0.5), -1.5))


def demo_lap() -> rd.Path:
    """One lap of a circle in six seconds, like that of the obstacle experiments of Moore & Oztop: 301 points."""
    lap = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=np.diag([-1.0, 1.0, -1.0]), n=301)
    return lap.with_times(np.linspace(0.0, 6.0, 301))


def demo_ball() -> rd.Scene:
    """The ball beside that circle, at the place where the elbow would hang."""
    return rd.Scene([rd.Sphere((0.2842, -0.3539, 0.4817), 0.06)])


def _leaning(
    positions: NDArray[np.float64], center: tuple[float, float, float], lean: float
) -> NDArray[np.float64]:
    """Tool down, leaning by `lean` rad per metre of horizontal distance from the centre."""
    away = positions - np.asarray(center)
    axis = lean * np.column_stack([-away[:, 1], away[:, 0], np.zeros(len(away))])
    angle = np.linalg.norm(axis, axis=1)[:, None, None]
    x, y, z = axis.T
    zero = np.zeros(len(axis))
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    # Rodrigues; np.sinc(x / pi) is sin(x) / x, also at 0.
    turn = (
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross
    )
    return np.asarray(turn @ np.diag([-1.0, 1.0, -1.0]))


if __name__ == "__main__":
    sys.exit(run())
