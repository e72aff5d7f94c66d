"""Synthetic scenes with known truth: a furnished room, a moving camera, images, hand-drawn-like annotations."""

from gtlayout.synth.config import SynthConfig
from gtlayout.synth.scene import Shot, shoot, synthesize

__all__ = ["Shot", "SynthConfig", "shoot", "synthesize"]
