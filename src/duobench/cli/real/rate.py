"""`duobench real rate`: a second rater looks at the films of trials."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import tyro

from duobench.cli.shared.advice import find_folder
from duobench.cli.shared.console import console, counted
from duobench.cli.shared.engine import load_engine
from duobench.cli.shared.interrupt import stopping
from duobench.cli.shared.page import serve_page


def rate(trials: tyro.conf.Positional[Path], rater: str, port: int = 0, lan: bool = False) -> None:
    """Rate the films of an evaluation on real arms again, and report how raters agree.

    Films come in an order of their own, without the names of the policies. The same command goes on
    where it was stopped.

    Args:
        trials: What was given to --out of duobench real eval.
        rater: Pseudonym of who rates.
        port: Port of the page; 0 takes a free one.
        lan: Let other machines in the network open the page, which is encrypted then.
    """
    find_folder(trials, "trials.json")
    load_engine()
    from duobench.files import locked
    from duobench.results.reporting.agreement import kappa_text
    from duobench.rig_sessions.rating import RatingSession
    from duobench.rig_sessions.trial_folder import TrialsFolder
    from duobench.rig_sessions.trial_report import write_trials_report

    folder, screen = TrialsFolder(trials), console()
    with ExitStack() as ending:
        ending.enter_context(locked(folder.ratings(rater).parent))
        server = serve_page(port, lan, "rating_page.html")
        ending.callback(server.close)
        session = RatingSession(folder, rater, server)
        screen.print(f"Open {server.url}\nCtrl-C ends it.")
        with stopping(session.stop):
            session.run()
    report = write_trials_report(folder)
    for each in report.agreements:
        screen.print(
            f"{each.a} and {each.b}: the same stage in {each.same_stage} of "
            f"{counted(each.episodes, 'episode')} (kappa {kappa_text(each.stage_kappa)}), the same "
            f"success in {each.same_success} (kappa {kappa_text(each.success_kappa)})"
        )
    screen.print(f"Report: {trials / folder.page.name}")
