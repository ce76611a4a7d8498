"""PyTorch beside OpenGL: Triton's library is loaded before Mesa's.

PyTorch's default wheel brings Triton, and to make an optimizer already imports it. Triton's library
and Mesa's software renderer each have an LLVM, and Mesa's is visible to whatever is loaded after
it: Triton's library would call into it, and the process would end in a segmentation fault.
"""

import ctypes
import os
import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path

_MESA = re.compile(r"/(lib(LLVM|OSMesa|gallium)|\w+_dri\.so)")
_MAPPED = Path("/proc/self/maps")
"""What is loaded into this process, on Linux."""
_OWN_SYMBOLS_FIRST = getattr(os, "RTLD_DEEPBIND", 0)  # a flag of glibc


@cache
def load_triton() -> str:
    """Load Triton's library, where it is installed, once in a process; that takes 0.03 s.

    None of its Python code runs, and whoever imports it later gets this library. Where Mesa came
    first, the library looks for symbols in itself first, which breaks it only beside an allocator
    that `LD_PRELOAD` names.

    Returns:
        What was done, in words.
    """
    try:
        spec = find_spec("triton")
    except ValueError:  # something that stands for it was put into `sys.modules`
        spec = None
    folders = (spec and spec.submodule_search_locations) or ()
    libraries = [path for folder in folders for path in Path(folder, "_C").glob("libtriton*.so")]
    if not libraries:
        return "not installed, so PyTorch does not use it"
    is_late = _MAPPED.exists() and _MESA.search(_MAPPED.read_text(encoding="utf-8"))
    try:
        for path in libraries:
            ctypes.CDLL(str(path), mode=os.RTLD_NOW | (_OWN_SYMBOLS_FIRST if is_late else 0))
    except OSError as error:
        return f"cannot be loaded, and PyTorch may crash beside OpenGL: {error}"
    return "loaded apart from OpenGL, so that PyTorch works beside it"
