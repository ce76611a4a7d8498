"""The page of a run that is followed, in a browser."""

from contextlib import closing
from pathlib import Path
from threading import Thread

from duobench.evaluation.replay.sources import FollowedRun
from duobench.evaluation.replay.viewer import Viewer
from duobench.evaluation.runners.evaluate import evaluate
from duobench.results.folder import RunFolder
from duobench.results.suite import Suite, find_tasks
from duobench.web.page import assets
from duobench.web.server import PageServer
from tests.pages.windows import broken_rules, opened, started, until


def test_a_run_is_followed_to_its_report(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    with started() as window, closing(PageServer(assets())) as server:
        run = FollowedRun(folder, server)
        viewer = Viewer(run, server, run.refresh)
        thread = Thread(target=viewer.run)
        thread.start()
        with opened(window, server.url) as page:
            until(page, "document.querySelector('#run').textContent.includes('Nothing is written')")
            suite = Suite(tasks=find_tasks(["bin_sort"]), episodes=2)
            folder_later = RunFolder(tmp_path / "later")
            evaluate("hold", suite, folder_later, workers=0)
            page_path, kept = folder_later.page, folder_later.page.with_suffix(".kept")
            page_path.rename(kept)
            folder_later.path.rename(folder.path)
            until(page, "document.querySelectorAll('#run tbody tr').length == 1")
            cells = page.locator("#run tbody td").all_text_contents()
            assert cells == ["2/2", "0", "0–66"]
            assert broken_rules(page) == []
            page.locator("#run .items button").first.click()
            until(page, "!!document.querySelector('.instruction').textContent")
            folder.page.with_suffix(".kept").rename(folder.page)
            page.wait_for_url("**/index.html*")
            assert "hold" in page.title()
            viewer.stop()
            thread.join()
        run.wait_for_visitors()
