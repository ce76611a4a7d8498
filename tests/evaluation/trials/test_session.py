from pathlib import Path

from duobench.results.source import read_source
from tests.evaluation.trials.operator import Operator, Stand, contenders, run


def test_one_trial_of_each_policy(tmp_path: Path) -> None:
    def script(operator: Operator) -> None:
        for _ in range(2):
            operator.begin()
            operator.play([[1], [3, 2], [None, None]])
            operator.finish()

    stand = Stand(tmp_path, contenders(), episodes=1)
    with stand.ending:
        assert run(stand, script)
    for letter in "AB":
        run_, (record,) = read_source(stand.folder.run(letter).path)
        assert run_.is_real
        assert record.final_stage == 1
        assert record.judged is not None
        assert [press.stage for press in record.judged.presses] == [1, 3, 2, None, None]
