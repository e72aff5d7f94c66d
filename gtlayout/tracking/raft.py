"""Dense optical flow in place of Lucas-Kanade: torchvision's RAFT (Teed and Deng 2020). Needs the extra ``raft``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.extras import MissingExtraError
from gtlayout.scene import BoolArray, FloatArray, ImageArray

_MULTIPLE = 8
"""RAFT wants sides that are multiples of this …"""
_LEAST_SIDE_PX = 128
"""… and not smaller than this: its correlation pyramid has four levels."""


@dataclass(frozen=True)
class RaftTracker:
    """``raft_small`` in both directions with forward-backward check."""

    network: Any
    """torchvision's network, in evaluation mode, on its device."""
    max_forward_backward_px: float

    @classmethod
    def load(cls, weights: Path, max_forward_backward_px: float) -> RaftTracker:
        """The tracker with the network's ``weights``: the state dictionary, as torchvision publishes it, in a file.

        It runs on a GPU where PyTorch finds one. Raises GtlayoutError when the extra is not installed, or the file
        cannot be read or holds the weights of something else.
        """
        torch, raft_small = _torch()
        try:
            # weights_only: a file from elsewhere must not run code.
            state = torch.load(weights, map_location="cpu", weights_only=True)
        except Exception as error:
            # PyTorch raises errors of many kinds for a damaged file.
            reason = getattr(error, "strerror", None) or "it is no PyTorch file, or damaged"
            raise GtlayoutError(f"cannot read the weights of RAFT, {weights}: {reason}") from error
        network = raft_small(weights=None)
        try:
            network.load_state_dict(state)
        except (RuntimeError, TypeError, AttributeError) as error:
            raise GtlayoutError(f"{weights} does not hold the weights of torchvision's raft_small") from error
        device = "cuda" if torch.cuda.is_available() else "cpu"
        return cls(network.eval().to(device), max_forward_backward_px)

    def __call__(
        self, source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """See ``PairTracker``. The flow needs no guess."""
        if len(points_px) == 0:
            return np.empty((0, 2)), np.empty(0, dtype=bool)
        there, back = self._flows(source, target)
        moved_px = points_px + _at(there, points_px)
        returned_px = moved_px + _at(back, moved_px)
        height, width = target.shape
        inside = np.all((moved_px >= 0) & (moved_px <= [width, height]), axis=1)
        close = np.linalg.norm(returned_px - points_px, axis=1) < self.max_forward_backward_px
        return moved_px, inside & close

    def _flows(self, source: ImageArray, target: ImageArray) -> npt.NDArray[np.float32]:
        """(2, H, W, 2) px: from ``source`` to ``target``, and back."""
        torch, _ = _torch()
        height, width = source.shape
        padding = [max(_LEAST_SIDE_PX, -(-side // _MULTIPLE) * _MULTIPLE) - side for side in (height, width)]
        images = np.stack([np.pad(image, [(0, rest) for rest in padding], mode="edge") for image in (source, target)])
        # The network is made for three channels in -1..1.
        scaled = images.astype(np.float32)[:, None].repeat(3, axis=1) / np.float32(127.5) - np.float32(1.0)
        first = torch.from_numpy(scaled).to(next(self.network.parameters()).device)
        with torch.inference_mode():
            flows = self.network(first, first.flip(0))[-1]
        found: npt.NDArray[np.float32] = flows[:, :, :height, :width].permute(0, 2, 3, 1).cpu().numpy()
        return found


def _at(flow: npt.NDArray[np.float32], points_px: FloatArray) -> FloatArray:
    """(N, 2) of the (H, W, 2) flow at ``points_px``, between pixels interpolated."""
    at = (points_px - 0.5).astype(np.float32)
    sampled = cv2.remap(flow, at[:, :1], at[:, 1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return sampled[:, 0].astype(np.float64)


def _torch() -> tuple[Any, Any]:
    """PyTorch, and what makes the network. Imported only here: nothing else needs them."""
    try:
        import torch
        from torchvision.models.optical_flow import raft_small
    except ImportError as error:
        raise MissingExtraError("RAFT needs PyTorch and torchvision: pip install 'gtlayout[raft]'") from error
    except RuntimeError as error:
        raise GtlayoutError(f"these versions of PyTorch and torchvision do not fit each other: {error}") from error
    return torch, raft_small
