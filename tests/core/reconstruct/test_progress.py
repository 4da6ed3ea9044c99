"""What a listener hears of a reconstruction, and how he ends it."""

import numpy as np
import pytest
from bsface import BSplineSurface, Cancelled, reconstruct
from bsface.progress import STAGES
from bsface.surface.alignment import eye_centres
from drawn_person import MOTION, QUICK


@pytest.mark.parametrize("settings", [QUICK, MOTION], ids=["joint", "motion"])
def test_progress_rises_to_one(drawn, settings):
    photos, marks = drawn
    steps = []
    made = reconstruct(photos[:3], settings, landmarks=marks, progress=steps.append)
    overall = [step.overall for step in steps]
    assert overall == sorted(overall)
    assert overall[0] >= 0
    assert overall[-1] == 1
    for step in steps:
        assert step.stage in STAGES
        assert 0 <= step.done <= step.total
        assert step.message
    order = list(dict.fromkeys(step.stage for step in steps))
    assert order == [stage for stage in STAGES if stage in order]
    # The face so far, in the size and place of the result; at last the result itself.
    faces = [step.control_points for step in steps if step.control_points is not None]
    for face in faces:
        assert face.shape == (*made.surface.shape, 3)
        eyes = eye_centres(BSplineSurface(face), made.template)
        assert np.allclose(sum(eyes), 0, atol=1e-6)
    assert np.allclose(faces[-1], made.surface.control_points, atol=1e-6)


def test_cancel_at_any_stage(drawn):
    photos, marks = drawn
    stages = []
    reconstruct(
        photos[:3], QUICK, landmarks=marks, progress=lambda s: stages.append(s.stage)
    )
    for stop in {stages.index(stage) for stage in stages}:
        seen = []

        def progress(step, stop=stop, seen=seen):
            seen.append(step)
            if len(seen) > stop:
                raise Cancelled

        with pytest.raises(Cancelled):
            reconstruct(photos[:3], QUICK, landmarks=marks, progress=progress)
        assert len(seen) == stop + 1


def test_other_errors_of_the_callback_pass_through(drawn):
    photos, marks = drawn

    def broken(step):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        reconstruct(photos[:1], MOTION, landmarks=marks, progress=broken)
