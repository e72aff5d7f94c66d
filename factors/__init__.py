"""GTSAM custom factors on ``OrientedPlane3`` and ``Point3`` variables; they know nothing of scenes.

Observations of landmarks need no custom factor: GTSAM's native ``TriangulationFactor`` evaluates them without Python.
"""

from gtlayout.factors.coplanarity import coplanarity_factor
from gtlayout.factors.cylinder import cylinder_edge_factor, cylinder_track_factor
from gtlayout.factors.depth import biased_depth_factor, depth_factor
from gtlayout.factors.edge import EdgeView, edge_factor
from gtlayout.factors.perpendicularity import perpendicularity_factor
from gtlayout.factors.prior import plane_prior_factor
from gtlayout.factors.track import track_factor

__all__ = [
    "EdgeView",
    "biased_depth_factor",
    "coplanarity_factor",
    "cylinder_edge_factor",
    "cylinder_track_factor",
    "depth_factor",
    "edge_factor",
    "perpendicularity_factor",
    "plane_prior_factor",
    "track_factor",
]
