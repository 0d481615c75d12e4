"""What tests of the command line share."""

import numpy as np
import pytest

from morphlet import Picture
from morphlet.report import story


@pytest.fixture
def no_drawing(monkeypatch):
    """Pictures of one pixel: drawing is tested elsewhere, and slow."""
    pixel = Picture(np.zeros((1, 1, 3), np.uint8), "none", "a test")
    for name in ("contact_sheet", "sphere_picture"):
        monkeypatch.setattr(story, name, lambda *_, **__: pixel)
