"""Sentences of the library in the words of the forms of the view Explore."""

from flexstage.comparison import MODEL_WORDS
from flexstage.web.page import in_page_words

# what a sentence says of options, and what the form calls it
_FIELDS = {
    "--over NAME=RANGE varies one": "a tick under “Parameters and bounds” varies one",
    "--without NAME leaves one out": "without its tick it is left out",
    "--start middle": "“Start” at the middle of all bounds",
    "--model superelement": f"the model of {MODEL_WORDS['superelement']}",
    "--maximise or --minimise a figure, or --match values": "“maximise”, “minimise” or “reach”",
    "--keep": "“What is required”",
    "--match": "“reach”",
    "--over": "“What is varied”",
    "--samples": "“Number of points”",
    "--require": "“What a good stage has”",
    "--target-yield": "“Yield to reach”",
    "--hinges": "“Neck and place of each hinge”",
    "--scatter": "“Scatter of the workshop”",
}


def in_form_words(sentence: str) -> str:
    """Return what the library says with the fields of a form in place of options.

    Examples
    --------
    >>> in_form_words("widen them, or start from their middle with --start middle")
    'widen them, or start from their middle with “Start” at the middle of all bounds'
    """
    for option, words in _FIELDS.items():
        sentence = sentence.replace(option, words)
    return in_page_words(sentence)
