"""Fabrication: files to print a task's objects with, how to print them, and where they go.

`write_prints` makes a folder of them; `outlines_of` gives the footprint of an object.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.fabrication.coupon import fit_coupon as fit_coupon
    from duobench.fabrication.folder import PrintChoice as PrintChoice
    from duobench.fabrication.folder import write_prints as write_prints
    from duobench.fabrication.formats import stl_bytes as stl_bytes
    from duobench.fabrication.formats import threemf_bytes as threemf_bytes
    from duobench.fabrication.parts import PrintedPart as PrintedPart
    from duobench.fabrication.parts import PrintJob as PrintJob
    from duobench.fabrication.parts import Spot as Spot
    from duobench.fabrication.parts import job_of as job_of
    from duobench.fabrication.parts import lay_out as lay_out
    from duobench.fabrication.recipe import Recipe as Recipe
    from duobench.fabrication.recipe import recipe_of as recipe_of
    from duobench.fabrication.sheet import layout_sheet as layout_sheet
    from duobench.fabrication.sheet import neutral_layout as neutral_layout
    from duobench.fabrication.sheet import outlines_of as outlines_of
    from duobench.sheets import Paper as Paper

lazy(__name__)
