"""What is printed on a terminal: texts as they are, without what it would obey, and notes in one faint line."""

from io import StringIO

from rich.progress import Progress

from kinreach._terminal import Console


def printed(*texts, note="", **options):
    file = StringIO()
    console = Console(file=file, width=20, **options)
    for text in texts:
        console.print(text)
    if note:
        console.note(note)
    return file.getvalue()


def test_texts_are_printed_as_they_are():
    assert printed("[red]:smile: 12 'a'") == "[red]:smile: 12 'a'\n"
    assert printed("[red]12 'a'", force_terminal=True) == "[red]12 'a'\n"
    assert printed("a\x1b[2Jb") == "a\\x1b[2Jb\n"


def test_a_note_is_one_faint_line_however_long_it_is():
    assert printed(note="word " * 9 + "[x]") == "word " * 9 + "[x]\n"
    assert printed(note="faint", force_terminal=True) == "\x1b[2mfaint\x1b[0m\n"


def test_a_bar_may_have_any_description():
    with Progress(console=Console(file=StringIO(), force_terminal=True, width=60)) as bar:
        bar.add_task("of \x1b[2J all", total=3)
    assert "\x1b[2J all" not in bar.console.file.getvalue()
