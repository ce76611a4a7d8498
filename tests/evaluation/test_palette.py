import pytest

from duobench.evaluation.figures import SUCCESS, ink_on, stage_colours


def luminance(colour: str) -> float:
    """Relative luminance after WCAG 2.2, from sRGB."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("max_stage", range(1, 8))
def test_stages_get_lighter_and_success_stands_apart(max_stage: int) -> None:
    colours = stage_colours(max_stage)
    assert len(colours) == max_stage + 1
    assert colours[-1] == SUCCESS
    failing = [luminance(colour) for colour in colours[:-1]]
    assert failing == sorted(set(failing))


@pytest.mark.parametrize("max_stage", range(1, 8))
def test_text_on_every_stage_can_be_read(max_stage: int) -> None:
    for colour in stage_colours(max_stage):
        assert contrast(colour, ink_on(colour)) >= 4.5
