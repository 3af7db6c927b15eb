"""Clips from videos: somebody's joints, found by MediaPipe with the weights in its wheel."""

from __future__ import annotations

from imapper_prob.detect.detect import detect

__all__ = ["detect"]
