"""What the camera saw, and the person projected back into it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.people import at_one_time, by_person, everybody
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.entities import log_moving, log_static, own_entity
from imapper_prob.recording.video import Video

__all__ = ["image_camera", "log_image"]

Array = NDArray[np.float64]


def image_camera(camera: Camera, video: Video | None) -> Camera:
    """The camera at the size of the recorded pictures: points and pictures share their pixels."""
    if video is None:
        return camera
    scale = video.width / camera.width
    return replace(
        camera,
        width=video.width,
        height=video.height,
        fx=scale * camera.fx,
        fy=scale * camera.fy,
        cx=scale * camera.cx,
        cy=scale * camera.cy,
    )


def log_image(
    recording: rr.RecordingStream,
    clip: Clip,
    best: Scene,
    frames: rr.TimeColumn,
    video: Video | None,
) -> Array:
    """Log camera, pictures, detections and reprojection.

    Returns
    -------
    (K T, 16, 2) float
        The K people of the scene in recorded pixels.
    """
    camera = image_camera(best.camera, video)
    scale = camera.width / best.camera.width
    log_static(recording, "world/camera", shapes.camera_pose(camera))
    log_static(recording, "world/camera/image", shapes.pinhole(camera))
    border = rr.Boxes2D(mins=[(0, 0)], sizes=[(camera.width, camera.height)], colors=(90, 95, 105))
    log_static(recording, "world/camera/image/border", border)
    if video is not None:
        _log_video(recording, video)
    everyone = everybody(clip)
    keypoints = at_one_time(clip, everyone.keypoints)
    confidences = at_one_time(clip, everyone.confidences)
    seen = np.isfinite(keypoints).all(-1) & (confidences > 0)
    log_moving(
        recording,
        "world/camera/image/detections",
        frames,
        rr.Points2D.columns(
            positions=scale * keypoints[seen],
            colors=palette.confidence_colours(confidences[seen]),
        ).partition(seen.sum(1)),
        style=rr.Points2D.from_fields(radii=rr.Radius.ui_points(4.0), draw_order=20.0),
    )
    pixels = camera.project(best.joints)
    for person, own in enumerate(by_person(clip, pixels)):
        drawn = np.isfinite(own).all(-1)
        log_moving(
            recording,
            own_entity(clip, "world/camera/image/reprojection", person),
            frames,
            rr.Points2D.columns(positions=own[drawn], keypoint_ids=np.nonzero(drawn)[1]).partition(
                drawn.sum(1)
            ),
            style=rr.Points2D.from_fields(
                class_ids=palette.REPROJECTION, radii=rr.Radius.ui_points(2.0), show_labels=False
            ),
        )
    return pixels


def _log_video(recording: rr.RecordingStream, video: Video) -> None:
    log_moving(
        recording,
        "world/camera/image/video",
        rr.TimeColumn("frame", sequence=video.frame_ids),
        rr.EncodedImage.columns(
            blob=list(video.pictures), media_type=["image/jpeg"] * len(video.pictures)
        ),
        style=rr.EncodedImage.from_fields(draw_order=-20.0),
    )
