import itertools

from duobench.results.figures import SUCCESS, ink_on, stage_colours

STAGES = range(1, 8)


def luminance(colour: str) -> float:
    """Relative luminance after WCAG 2.2, from sRGB."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_stages_get_lighter_and_success_stands_apart() -> None:
    for max_stage in STAGES:
        *failing, last = stage_colours(max_stage)
        assert len(failing) == max_stage
        assert last == SUCCESS
        brightness = [luminance(colour) for colour in failing]
        assert brightness == sorted(set(brightness))


def test_text_on_every_stage_can_be_read() -> None:
    for colour in itertools.chain.from_iterable(map(stage_colours, STAGES)):
        assert contrast(colour, ink_on(colour)) >= 4.5, colour
