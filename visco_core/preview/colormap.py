"""Scalars as colors, and the legend that explains them."""

from __future__ import annotations

from typing import Literal

import numpy as np

ColorMapName = Literal["heat", "viridis"]

# Ten even steps of matplotlib's magma (reversed, without its near black end) and viridis, which
# are perceptually uniform (Smith and van der Walt, 2015; CC0).
_STEPS = {
    "heat": "fcfdbf fecf92 fe9f6d f7705c de4968 b73779 8c2981 641a80 3b0f70",
    "viridis": "440154 482878 3e4989 31688e 26828e 1f9e89 35b779 6ece58 b5de2b fde725",
}


def colors_of(
    values: np.ndarray, low: float, high: float, name: ColorMapName = "heat"
) -> np.ndarray:
    """sRGB (V, 3) float32 from 0 to 1 of values (V,); beyond ``low`` and ``high`` the end colors.

    A NaN is gray.
    """
    steps = np.array([list(bytes.fromhex(step)) for step in _STEPS[name].split()]) / 255.0
    share = np.clip((values - low) / max(high - low, 1e-300), 0.0, 1.0)
    place = np.linspace(0.0, 1.0, len(steps))
    columns = [np.interp(share, place, steps[:, channel]) for channel in range(3)]
    colors = np.stack(columns, axis=1).astype(np.float32)
    colors[np.isnan(values)] = 0.6
    return colors


def draw_legend(
    picture: np.ndarray, low: float, high: float, label: str, name: ColorMapName = "heat"
) -> np.ndarray:
    """``picture`` (H, W, 4) uint8 with a titled bar at its left, marked at its ends and middle."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    height = picture.shape[0]
    font = ImageFont.load_default(max(height // 42, 10))
    left, top, bottom = height // 24, height // 4, height - height // 4
    width = height // 40
    shades = colors_of(np.linspace(1.0, 0.0, bottom - top), 0.0, 1.0, name)
    bar = np.repeat(np.rint(255.0 * shades).astype(np.uint8)[:, None], width, axis=1)
    image.paste(Image.fromarray(bar), (left, top))
    ink = (60, 64, 70, 255)
    draw.rectangle((left, top, left + width - 1, bottom - 1), outline=ink)
    for share in (0.0, 0.5, 1.0):
        value = low + share * (high - low)
        text = f"{0.0 if abs(value) < 1e-3 * (high - low) else value:.3g}"
        row = bottom - share * (bottom - top)
        draw.text((left + 1.4 * width, row), text, fill=ink, font=font, anchor="lm")
    draw.text((left, top - 0.8 * width), label, fill=ink, font=font, anchor="ls")
    return np.asarray(image)
