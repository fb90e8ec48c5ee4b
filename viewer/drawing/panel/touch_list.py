"""The list of touches beside the body: what each is, where, how large and hard."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.response.loads import ContactForce
from viewer.colours import FAINT, INK, NO_NAMES, ink_on, touch_colour
from viewer.colours import faded as pale
from viewer.drawing.words.shapes import Line, small_font

HEAD, ROW, TIGHT = 1.9, 2.95, 1.5  # heights in font heights: title, two lines, one line
LETTER, GAP = 0.46, "   "  # mean width of a letter in its height; between two words
MOST, MAX_TIGHT = 6, 12  # touches listed in two lines each, and in one
ROOM, SCANT = 0.4, 0.25  # of the panel's height at most; where traces stand above the list


class TouchList:
    """Rows at the bottom of a panel, each written only when it changes.

    A few touches take two lines each, many of them one; of more than fit, the largest are listed.
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer = renderer
        self._head = Line(renderer, (0.0, 0.0), 12, bold=True)
        self._rows = [
            (Line(renderer, (0.0, 0.0), 12, bold=True), Line(renderer, (0.0, 0.0), 12))
            for _ in range(MAX_TIGHT)
        ]
        self._more = Line(renderer, (0.0, 0.0), 12)
        self.fits, self.fits_tight = MOST, MAX_TIGHT
        self.scant = False
        self._left, self._font_px = 0.0, 12
        self._shown: tuple[Sequence[NamedTouch], float] = ((), 0.0)
        self._faded, self._about, self._instead = False, "no touch", ""

    @property
    def texts(self) -> tuple[str, ...]:
        """All that is written now, from the top."""
        lines = [self._head, *[line for row in self._rows for line in row], self._more]
        return tuple(line.text for line in lines if line.text)

    def height(self, font_px: int) -> float:
        """What it takes from the bottom of the panel [px]."""
        share = SCANT if self.scant else ROOM
        room = share * float(self.renderer.GetSize()[1]) / font_px - HEAD
        self.fits = int(np.clip(room / ROW, 1, MOST))
        self.fits_tight = int(np.clip(self.fits * ROW / TIGHT, 1, MAX_TIGHT))
        return (HEAD + ROW * self.fits + 1.0) * font_px

    def place(self, left: float, font_px: int) -> None:
        """Stand at the bottom, `left` [px] from the side."""
        self._left, self._font_px = left, font_px
        top = self.height(font_px)
        self._head.style(font_px, bold=True)
        self._head.move(left, top)
        self._more.style(small_font(font_px))
        self._more.move(left, top - (HEAD + ROW * self.fits) * font_px + 0.2 * font_px)
        self.show(*self._shown, faded=self._faded)

    def show(self, touches: Sequence[NamedTouch], time: float, *, faded: bool = False) -> None:
        """List touches as they are at a time [s]; faded where nothing new is heard of them."""
        self._shown, self._faded = (tuple(touches), time), faded
        count = len(touches)
        nothing = self._instead or "no touch"
        self._about = nothing if not count else f"{count} touch{'es' * (count > 1)}"
        self._head.write(self._about)
        tight = count > self.fits
        fits = self.fits_tight if tight else self.fits
        listed = largest(touches, fits)
        for row, lines in enumerate(self._rows):
            if row < len(listed):
                self._write(row, listed[row], time, tight=tight)
            else:
                for line in lines:
                    line.write("")
        self._more.write(f"+{count - fits} more" if count > fits else "", INK)

    def tell(self, about: str) -> None:
        """Stand in for the count of touches, until `show` is called again with others."""
        self._instead = about
        self._head.write(about)

    def tell_age(self, age: float | None) -> None:
        """Say how long ago it was that the touches were heard of [s]; None while they are."""
        late = "" if age is None or not self._shown[0] else f", {age:.0f} s ago"
        self._head.write(self._about + late)

    def _write(self, row: int, touch: NamedTouch, time: float, *, tight: bool) -> None:
        """One touch in its row: what is known of it below its name, or behind it."""
        name, about = self._rows[row]
        font, small = self._font_px, small_font(self._font_px)
        y = self.height(font) - (HEAD + (TIGHT if tight else ROW) * row) * font
        colour = touch_colour(touch)
        colour = pale(colour) if self._faded else colour
        name.style(small if tight else font, bold=True)
        name.move(self._left, y)
        name.back(colour, 1.0)
        name.write(f" {caption(touch)} ", ink_on(colour))
        about.style(small)
        left = self._left + (name.width() + 0.6 * font if tight else 0.0)
        about.move(left, y if tight else y - 1.4 * font)
        about.write(self._fitting(details(touch, time), left), FAINT)

    def _fitting(self, words: Sequence[str], left: float) -> str:
        """As many of the words as the panel is wide from `left` [px], the first ones first."""
        width = float(self.renderer.GetSize()[0]) - self._left - left
        room = int(width / (LETTER * small_font(self._font_px)))
        while len(words) > 1 and len(GAP.join(words)) > room:
            words = words[:-1]
        text = GAP.join(words)
        return text if len(text) <= room else f"{text[: max(room - 1, 0)]}\N{HORIZONTAL ELLIPSIS}"


def largest(touches: Sequence[NamedTouch], most: int) -> list[NamedTouch]:
    """The largest of some touches, in the order in which they came."""
    order = sorted(range(len(touches)), key=lambda row: -len(touches[row].taxels))
    return [touches[row] for row in sorted(order[:most])]


def caption(touch: NamedTouch) -> str:
    """A touch in words: its class and, where known, its confidence."""
    name = touch.label.replace("_", " ")
    return f"{name} {touch.confidence:.0%}".replace("%", " %") if known(touch.confidence) else name


def details(touch: NamedTouch, time: float) -> list[str]:
    """Where a touch is and how large, hard and long; what is not known is left out."""
    forces = [] if touch.load is None else loaded(touch.load)  # early: a panel has room for few
    words = [touch.part.replace("_", " "), *forces, *answered(touch)]
    if known(touch.area):
        words.append(covered(touch))
    if touch.load is None and known(touch.peak):
        words.append(f"peak {touch.peak:.0f}")
    if known(time - touch.began):
        words.append(f"{max(time - touch.began, 0.0):.1f} s")
    motion = touch.motion
    if motion is not None and motion.heading != "still":
        words.append(f"{motion.heading} {1e3 * motion.speed:.0f} mm/s")
    if motion is not None and motion.presses > 1:
        words.append(f"{motion.presses} times")
    return words


def loaded(load: ContactForce) -> list[str]:
    """Force and peak pressure with their intervals of 90 %, or why there is none."""
    if load.refused:
        return [f"no force: {load.refused}"]
    force, low, high = load.force
    return [f"{force:.1f} N ({low:.1f} to {high:.1f})", f"peak {1e-3 * load.peak.value:.0f} kPa"]


def covered(touch: NamedTouch) -> str:
    """Skin that a touch covers, at least and at most."""
    least, most = touch.area_least, touch.area
    if touch.load is not None and not touch.load.refused:
        _, least, most = touch.load.area
    ends = [f"{1e6 * end:,.0f}" for end in (least, most) if known(end)]
    return "\N{EN DASH}".join(ends) + " mm\N{SUPERSCRIPT TWO}"


def answered(touch: NamedTouch) -> list[str]:
    """Kind, motion and hand in words; nothing where no model answers.

    The kind is called one where the label is another, and left out of a touch without a name.
    """
    if touch.answers is None:
        return []
    kind, motion = touch.answers.kind.answer, touch.answers.motion.answer
    if touch.label in NO_NAMES:
        words = motion
    else:
        words = f"{kind}, {motion}" if kind == touch.label else f"kind {kind}, {motion}"
    hand = {"hand": "hand", "other": "no hand", "unsure": "hand?"}[touch.answers.hand.answer]
    return [words.replace("_", " "), hand]


def known(number: float | None) -> bool:
    """Whether there is such a number."""
    return number is not None and bool(np.isfinite(number))
