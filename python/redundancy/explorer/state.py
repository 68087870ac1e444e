"""The state of the page as JSON, and back."""

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import redundancy as rd
from redundancy.explorer.map_model import AXES
from redundancy.explorer.model import RefusedError, checked_pose, checked_q, finite
from redundancy.explorer.path_model import checked_speed

if TYPE_CHECKING:
    from redundancy.explorer.view import View

VERSION = 1
LONGEST = 8_000_000
"""Longest text that is read as a state, characters."""


def to_json(view: "View") -> str:
    """Everything that a user changed, as JSON text."""
    pose = view.pose
    out: dict[str, Any] = {
        "redundancy_explorer": VERSION,
        "robot": pose.chain.name,
        "joint_names": pose.chain.joint_names,
        "target": pose.target.tolist(),
        "q": pose.q.tolist(),
        "piece": None if pose.piece is None else pose.pieces[pose.piece].label,
        "u": pose.u,
        "criterion": pose.criterion,
        "tilt": pose.tilt.tolist(),
        "spin": pose.spin,
        "ghosts": bool(view.pose_panel.show_ghosts.value),
        "scene": json.loads(view.scene.scene.to_json()),
        "time": view.path.time,
        "speed": view.path.speed,
    }
    if view.map.found is not None:
        out["map"] = {
            "layer": view.map.layer,
            "axis": AXES[view.map.axis],
            "at": view.map.at,
            "shown": bool(view.map_panel.shown.value),
        }
    return json.dumps(out, indent=2, allow_nan=False)


def load(view: "View", text: str) -> None:
    """Restore a state: everything is checked before anything changes.

    Raises:
        RefusedError: No such JSON, another arm, wrong numbers; the message says which.
    """
    values = parsed(text)
    pose = view.pose
    if values.get("joint_names") != pose.chain.joint_names:
        raise RefusedError(
            f"the state is of the arm '{values.get('robot')}', this one is '{pose.chain.name}' with other joints"
        )
    target, q = checked_pose(values.get("target")), checked_q(pose.chain, values.get("q"))
    tilt, spin = (
        finite(values.get("tilt", [0.0, 0.0]), (2,), "tilt"),
        float(finite(values.get("spin", 0.0), (), "spin")),
    )
    time, u = (float(finite(values.get(name, 0.0), (), name)) for name in ("time", "u"))
    speed = checked_speed(values.get("speed", 1.0))
    criterion, label = values.get("criterion", pose.criterion), values.get("piece")
    if criterion not in pose.criteria:
        raise RefusedError(f"the criterion {str(criterion)[:40]!r} is none of {', '.join(pose.criteria)}")
    try:
        scene = rd.Scene.from_json_string(json.dumps(values.get("scene", {"obstacles": []})))
    except rd.RedundancyError as error:
        raise RefusedError(f"the scene of the state: {error}") from error
    restore_map = checked_map(view, values.get("map"))
    view.path_panel.cancel()  # a plan in progress is for other obstacles
    view.take_the_arm()
    view.scene.set_scene(scene)
    pose.choose_criterion(criterion)
    pose.set_scene(view.scene.scene)
    if pose.freedom is not None:
        pose.tilt, pose.spin = tilt, spin
    pose.restore(target, q, label if isinstance(label, str) else None, u)
    view.path.set_speed(speed)
    view.path.set_time(time)
    view.pose_panel.show_ghosts.value = bool(values.get("ghosts", True))
    restore_map()
    view.show_everything()


def checked_map(view: "View", values: Any) -> Callable[[], None]:
    """What restores the slice of the map; a page without a map has none to restore."""
    model = view.map
    if values is None or model.found is None:
        return lambda: None
    if not isinstance(values, dict):
        raise RefusedError(f"the map of the state is no object: {str(values)[:40]}")
    layer, axis = str(values.get("layer", model.layer)), str(values.get("axis", AXES[model.axis]))
    at = float(finite(values.get("at", model.at), (), "the place of the slice"))
    if layer not in model.layers or axis not in AXES:
        raise RefusedError(
            f"the state shows '{layer[:40]}' across '{axis[:8]}', which this map does not have"
        )

    def restore() -> None:
        model.choose(layer)
        model.cut(axis, at)
        view.map_panel.shown.value = bool(values.get("shown", True))

    return restore


def parsed(text: str) -> dict[str, Any]:
    """The members of a state."""
    if len(text) > LONGEST:
        raise RefusedError(f"the state has {len(text)} characters, at most {LONGEST} are read")
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RefusedError(f"the state is no JSON: {error}") from None
    if not isinstance(values, dict) or values.get("redundancy_explorer") != VERSION:
        raise RefusedError(f"this is no state of the explorer (redundancy_explorer is not {VERSION})")
    return values
