from duobench.assets.progress import shown


def test_nothing_is_written_while_nothing_happens(capfd):
    with shown(True):
        pass
    assert capfd.readouterr() == ("", "")


def test_bars_go_to_the_error_stream(capfd):
    with shown(True) as report:
        report("first", 0, 10)
        report("second", 5, 0)
        report("first", 10, 10)
    out, err = capfd.readouterr()
    assert out == ""
    assert "first" in err
    assert "second" in err
    assert "100%" in err


def test_progress_can_be_turned_off(capfd):
    with shown(False) as report:
        report("first", 0, 10)
    assert capfd.readouterr() == ("", "")
