import sys

import pytest
from screens import screen
from test_progress import FULL, shown

from agglom_mpi.display.terminal import LiveLines, Terminal


@pytest.fixture(params=[120, 80, 40])
def opened(request):
    with screen(request.param, 20) as opened:
        yield opened


def stream_to(opened, encoding="utf-8"):
    return open(opened.slave, "w", encoding=encoding, closefd=False)


def live_on(opened, in_foreground=lambda: True, encoding="utf-8"):
    return LiveLines(Terminal(stream_to(opened, encoding), in_foreground))


def write(opened, text):
    """Write to a terminal as another process does."""
    with stream_to(opened) as stream:
        stream.write(text)


def columns(opened):
    return len(opened._screen.display[0])


def test_the_lines_are_shown_below_two_empty_ones_and_messages_above(opened):
    live = live_on(opened)
    live.draw(FULL)
    live.draw(FULL._replace(done=13))
    live.print_above("a message")
    wanted = shown(FULL._replace(done=13), columns(opened))
    assert opened.read() == ["a message", "", "", *wanted]
    assert opened.cursor == (0, 1)


def test_fewer_lines_than_before_leave_nothing_behind(opened):
    live = live_on(opened)
    live.draw(FULL)
    less = FULL._replace(best=None, failed=0, remaining=None, note="")
    live.draw(less)
    assert opened.read() == ["", "", *shown(less, columns(opened))]


def test_nothing_is_left_when_it_stops(opened):
    live = live_on(opened)
    live.print_above("before")
    live.draw(FULL)
    live.erase()
    live.print_above("after")
    assert opened.read() == ["before", "after"]


def test_a_message_that_is_too_long_breaks_between_words(opened):
    live = live_on(opened)
    live.draw(FULL)
    live.print_above(" ".join(["word"] * 40))
    said = opened.read()[: -len(shown(FULL, columns(opened))) - 2]
    assert len(said) > 1
    assert {word for line in said for word in line.split()} == {"word"}


@pytest.mark.parametrize("width", [100, 60, 25, 119])
def test_after_a_resize_there_is_nothing_but_the_lines(width):
    with screen(80, 20) as opened:
        live = live_on(opened)
        live.print_above("before")
        live.draw(FULL)
        opened.read()
        opened.resize(width, 20)
        live.draw(FULL)
        assert opened.read() == ["before", "", "", *shown(FULL, width)]


def test_lines_that_a_terminal_has_broken_are_overwritten():
    """A terminal that reflows keeps the cursor where it is: at the beginning of the first line."""
    with screen(40, 20) as opened:
        live = live_on(opened)
        live.print_above("before")
        for line in ["", "", *shown(FULL, 80)]:
            write(opened, f"{line}\r\n")
        opened.read()
        write(opened, "\x1b[8A\r")  # two empty lines, and three of two rows each
        live.draw(FULL)
        assert opened.read() == ["before", "", "", *shown(FULL, 40)]


def test_what_others_write_stays(opened):
    live = live_on(opened)
    live.draw(FULL)
    write(opened, "^C[launcher] Sending Ctrl-C\r\n")
    live.draw(FULL)
    live.erase()
    assert opened.read() == ["^C[launcher] Sending Ctrl-C"]


def test_a_low_terminal_shows_what_fits():
    with screen(40, 5) as opened:
        live = live_on(opened)
        for _ in range(3):
            live.draw(FULL)
        assert opened.read() == ["", "", *shown(FULL, 40)[:2]]


def test_in_the_background_nothing_is_drawn_and_messages_are_lines():
    with screen(80) as opened:
        live = live_on(opened, in_foreground=lambda: False)
        live.draw(FULL)
        live.print_above("a message")
        live.erase()
        assert opened.read() == ["a message"]


def test_ascii_is_enough():
    with screen(80) as opened:
        live = live_on(opened, encoding="ascii")
        live.draw(FULL)
        opened.read()
        assert opened.raw.isascii()
        assert opened.lines == ["", "", *shown(FULL, 80, "ascii")]


def test_a_terminal_that_is_gone_does_not_end_the_run():
    with screen(80) as opened:
        stream = stream_to(opened)
        live = LiveLines(Terminal(stream, lambda: True))
        live.draw(FULL)
        stream.close()
        live.draw(FULL)
        live.erase()


def test_a_refresh_takes_at_most_two_thousand_calls():
    """Rank 0 draws twice a second, and serves all other ranks: that is half a millisecond."""
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    with screen(120) as opened:
        live = live_on(opened)
        live.draw(FULL)
        sys.setprofile(count)
        live.draw(FULL)
        sys.setprofile(None)
    assert 100 < calls < 2000
