"""The robot's views on a board, for somebody who wears a headset."""

from __future__ import annotations

import numpy as np

from tests.pages.driving import opened, take_the_drive
from tests.pages.test_headset import IWER, WEAR
from tests.pages.test_views import Shown, inset
from tests.pages.windows import complaints_of, until

COUNT = """
window.hung = 0;
const draw = OffscreenCanvasRenderingContext2D.prototype.drawImage;
OffscreenCanvasRenderingContext2D.prototype.drawImage = function (...given) {
  window.hung += 1;
  return draw.apply(this, given);
};
"""


def test_views_hang_on_a_board_and_move_with_the_arms() -> None:
    shown = Shown()
    with opened(IWER, WEAR, COUNT) as page:
        complaints = complaints_of(page)
        page.set_viewport_size({"width": 700, "height": 560})
        take_the_drive(page, shown.server.url, shown.show)
        page.get_by_role("button", name="Enter VR").click()
        until(page, "window.hung >= 3")
        seen, hung = inset(page, "right_wrist"), page.evaluate("window.hung")
        shown.turn(0.3)
        shown.show()
        until(page, f"window.hung >= {hung + 6}")
        assert np.abs(inset(page, "right_wrist") - seen).mean() > 5
        assert complaints == []
    shown.server.close()
