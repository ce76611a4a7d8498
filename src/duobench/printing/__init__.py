"""Fabrication: files to print a task's objects with, how to print them, and where they go.

`write_prints` makes a folder of them; `outlines_of` gives the footprint of an object.
"""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.core.sheets import Paper as Paper
    from duobench.printing.coupon import fit_coupon as fit_coupon
    from duobench.printing.folder import PrintChoice as PrintChoice, write_prints as write_prints
    from duobench.printing.formats import stl_bytes as stl_bytes, threemf_bytes as threemf_bytes
    from duobench.printing.jig import Foot as Foot, placing_jig as placing_jig
    from duobench.printing.parts import (
        PrintedPart as PrintedPart,
        PrintJob as PrintJob,
        Spot as Spot,
        job_of as job_of,
        lay_out as lay_out,
    )
    from duobench.printing.recipe import Recipe as Recipe, recipe_of as recipe_of
    from duobench.printing.sheet import (
        layout_sheet as layout_sheet,
        neutral_layout as neutral_layout,
        outlines_of as outlines_of,
    )

lazy(__name__)
