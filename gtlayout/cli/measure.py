"""The command ``measure``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from gtlayout.api import load_solved
from gtlayout.cli.console import FROM_THE_FOLDER, SceneDir, Sources, print_next, stdout
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json_list, write_json_atomic
from gtlayout.io.measurements import FILE, SIGMA_DEG, SIGMA_M, measurement_entry, read_measurements
from gtlayout.layout import Layout
from gtlayout.measured.measurables import NotMeasurableError, instances_of, measurable_of
from gtlayout.measurement import ElementName, MeasuredKind, Measurement
from gtlayout.results.tables import dimensions, measurement_lines
from gtlayout.scene import Scene

DOOR_LEAF_M, DOOR_LEAF_SIGMA_M = 2.01, 0.015
"""Heights of door leaves that are made: 1.98 to 2.04 m."""
_Pair = tuple[str, str, float] | None
_One = tuple[str, float] | None


def measure(
    scene_dir: SceneDir,
    /,
    *,
    between: _Pair = None,
    width: _One = None,
    height: _One = None,
    sill: _One = None,
    angle: _Pair = None,
    sigma: Annotated[float | None, Parameter(validator=Number(gt=0))] = None,
    door_leaf: Annotated[bool, Parameter(negative=())] = False,
    layout: Path | None = None,
    sources: Sources = FROM_THE_FOLDER,
) -> None:
    """Add what was measured in the room by hand to measurements.json; without any, say what to measure next.

    The scene must be solved. Names are those of its instances. The next solve takes the measurements in: all planes
    move to where they fit, every σ shrinks, and a scene without a unit gets one. A measurement that contradicts
    everything else is named and not used.

    Parameters
    ----------
    scene_dir
        The scene folder.
    between
        Two instances that face each other, and their distance in metres: floor_0 ceiling_0 2.513.
    width
        A door or window, and its width in metres.
    height
        A door or window, and its height in metres.
    sill
        A window, and the height of its lower edge over the floor in metres.
    angle
        Two instances, and the angle of their normals in degrees: 90 for walls at right angles.
    sigma
        σ of what is given, in the same unit; 0.003 m and 0.5° when not given.
    door_leaf
        Take every door to be 2.01 ± 0.015 m high, as most leaves are. It is assumed, not measured.
    layout
        Folder that holds layout.json; DIR/gtlayout when not given.
    """
    scene, solved = load_solved(scene_dir, layout, **vars(sources))
    given: list[tuple[MeasuredKind, tuple[str, ...], float]] = []
    kinds: tuple[tuple[MeasuredKind, _Pair | _One], ...] = (
        ("between", between),
        ("width", width),
        ("height", height),
        ("sill", sill),
        ("angle", angle),
    )
    for kind, value in kinds:
        if value is not None:
            *names, number = value
            given.append((kind, tuple(str(name) for name in names), float(number)))
    room = SolvedRoom(scene, solved.instances, solved.planes, solved.extents)
    new = [_found(room, Measurement(kind, names, value, sigma or _sigma(kind))) for kind, names, value in given]
    if door_leaf:
        new += _door_leaves(room)
    console = stdout()
    if not new:
        for line in _known(scene, solved):
            console.print(line)
        return
    _append(scene_dir / FILE, scene, new)
    for one in new:
        console.print(f"{one.name} = {one.value:g} {one.unit} ± {one.sigma:g}: written to {scene_dir / FILE}")
    print_next(console, "solve", scene_dir)


def _sigma(kind: MeasuredKind) -> float:
    return SIGMA_DEG if kind == "angle" else SIGMA_M


def _found(room: SolvedRoom, measurement: Measurement) -> Measurement:
    """The measurement with an element of each of its instances. Raises GtlayoutError when it is of nothing."""
    try:
        of = instances_of(room, measurement)
        measurable_of(room, measurement)
    except NotMeasurableError as reason:
        raise GtlayoutError(f"{measurement.name}: {reason}") from reason
    elements = []
    for i in of:
        k, e = max(room.instances[i].members, key=lambda m: room.scene.key_frames[m[0]].elements[m[1]].amodal.area)
        elements.append(ElementName(room.scene.frame_of(k).name, room.scene.key_frames[k].elements[e].id))
    return Measurement(
        measurement.kind,
        measurement.instances,
        measurement.value,
        measurement.sigma,
        tuple(elements),
        assumed=measurement.assumed,
    )


def _door_leaves(room: SolvedRoom) -> list[Measurement]:
    """The height of every door that is seen whole, assumed. Raises GtlayoutError when there is none."""
    found = []
    for i in room.seen:
        if room.instances[i].label == "door":
            one = Measurement("height", (room.instances[i].name,), DOOR_LEAF_M, DOOR_LEAF_SIGMA_M, assumed=True)
            try:
                measurable_of(room, one)
            except NotMeasurableError:
                continue
            found.append(_found(room, one))
    if not found:
        raise GtlayoutError("no door is seen from its lower to its upper end: the height of a leaf tells nothing")
    return found


def _append(path: Path, scene: Scene, new: list[Measurement]) -> None:
    """Write the file with more entries; those that are there stay as they are, whatever else they hold."""
    entries: list[Any] = []
    if path.exists():
        read_measurements(path, scene.frames)
        entries = read_json_list(path)
    write_json_atomic(path, [*entries, *(measurement_entry(one) for one in new)])


def _known(scene: Scene, solved: Layout) -> list[str]:
    waiting = len(scene.measurements) - len(solved.measurements)
    more = [f"{waiting} more in {scene.root / FILE}: solve the scene again"] if waiting > 0 else []
    return [*dimensions(solved), *measurement_lines(solved), *more]
