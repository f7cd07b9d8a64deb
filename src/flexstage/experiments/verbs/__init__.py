"""Verbs of a plan: one file for each, and one line here."""

from flexstage.experiments.verb import Verb
from flexstage.experiments.verbs.centre import Centre
from flexstage.experiments.verbs.characterise import Characterise
from flexstage.experiments.verbs.compensate import Compensate
from flexstage.experiments.verbs.excite import Excite
from flexstage.experiments.verbs.identify import Identify
from flexstage.experiments.verbs.measure import Measure
from flexstage.experiments.verbs.verify import Verify

#: Verbs by name; the report has their sections in this order.
VERBS: dict[str, type[Verb]] = {
    verb.verb: verb
    for verb in (Excite, Measure, Characterise, Identify, Compensate, Verify, Centre)
}
