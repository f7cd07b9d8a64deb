"""Every picture of the manual has what makes it, and a page that shows it."""

from docs.pictures import BY_HAND, COMMANDS, IMAGES, PAGES, PICTURES
from tests.meta.test_docs_snippets import PAGES as TEXTS


def test_every_picture_is_made_once_and_shown() -> None:
    made = [*PICTURES, *PAGES, *COMMANDS, *BY_HAND]
    assert sorted(made) == sorted(file.name for file in IMAGES.iterdir())
    text = "".join(page.read_text("utf-8") for page in TEXTS)
    assert [name for name in made if f"images/{name}" not in text] == []
