"""Build the site in `site/html`: every warning is an error.

`make site` runs it, and then the tests of what is built.
"""

import argparse
import sys
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path.append(str(ROOT))  # for tests/ways, whose names say what must not count

from site_stage import stage  # noqa: E402
from sphinx.cmd.build import build_main  # noqa: E402


def main() -> None:
    """Lay out what Sphinx reads, and run it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "site", help="folder of all of it")
    out: Path = parser.parse_args().out
    source, extra = out / "source", out / "extra"
    stage(source, extra)
    words = ["-b", "html", "-c", str(DOCS), "-d", str(out / "doctrees"), "-W", "--keep-going", "-q"]
    sys.exit(build_main([*words, "-D", f"html_extra_path={extra}", str(source), str(out / "html")]))


if __name__ == "__main__":
    main()
