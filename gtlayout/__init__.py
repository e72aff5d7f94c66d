"""gtlayout: posed video and 2D annotations → the room's structural planes with uncertainty.

``room`` is a scene folder; ``gtlayout synth room --frames 24 --width 320 --height 240`` makes one.

>>> from pathlib import Path
>>> import gtlayout
>>> scene = gtlayout.load("room")
>>> solution = gtlayout.solve(scene)
>>> solution.quality.headline.word
'trust'
>>> layout = solution.layout
>>> [instance.name for instance in layout.instances if instance.label != "wall"]
['floor_0', 'ceiling_0', 'door_0', 'window_0']
>>> ceiling = layout.planes[1]
>>> ceiling.normal.round(1) + 0.0  # n · X + d = 0, towards the cameras; the z of this world is up
array([ 0.,  0., -1.])
>>> 0 < ceiling.sigma_depth_m < 0.1
True
>>> layout.mesh().is_empty
False
>>> labels, depth = layout.render(scene.frames[0].camera)
>>> labels.shape == depth.shape == (240, 320)
True
>>> gtlayout.save(solution, "room/gtlayout")
>>> scene, layout = gtlayout.load_solved("room")
>>> gtlayout.export.export_layout(Path("room.svg"), scene, layout, "svg")
>>> gtlayout.evaluate(scene, layout).depth.median < 0.02
True

The command line calls the same functions. Nothing is imported before it is used, because OpenCV and GTSAM take seconds.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from gtlayout.version import __version__ as __version__

if TYPE_CHECKING:
    from gtlayout import check, export
    from gtlayout.api import load, load_solved, save
    from gtlayout.closing.close import close
    from gtlayout.config import Config
    from gtlayout.errors import GtlayoutError
    from gtlayout.evaluation.evaluate import Evaluation, evaluate
    from gtlayout.layout import Layout
    from gtlayout.measurement import Measurement
    from gtlayout.method import solve, with_measurements
    from gtlayout.scene import Camera, Scene
    from gtlayout.solution import Solution

__all__ = [
    "Camera",
    "Config",
    "Evaluation",
    "GtlayoutError",
    "Layout",
    "Measurement",
    "Scene",
    "Solution",
    "check",
    "close",
    "evaluate",
    "export",
    "load",
    "load_solved",
    "save",
    "solve",
    "with_measurements",
]

_HOME = {
    "Camera": "scene",
    "Config": "config",
    "Evaluation": "evaluation.evaluate",
    "GtlayoutError": "errors",
    "Layout": "layout",
    "Measurement": "measurement",
    "Scene": "scene",
    "Solution": "solution",
    "close": "closing.close",
    "evaluate": "evaluation.evaluate",
    "load": "api",
    "load_solved": "api",
    "save": "api",
    "solve": "method",
    "with_measurements": "method",
}
"""The module in which each name is defined. The other names are modules."""


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = import_module(f"{__name__}.{_HOME.get(name, name)}")
    if name in _HOME:
        value = getattr(value, name)
        globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
