"""``report.html``: a self-contained page with the whole result, which works offline.

The reader can switch between scenes, hover over plots, and move the person with a slider. All
scripts are inside the page, and its content policy forbids network access.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

from imapper_prob.files import written_whole
from imapper_prob.models.drawing import INK, QUIET
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import as_probability, with_error
from imapper_prob.people import by_person
from imapper_prob.recording.posterior import HIDDEN
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.report_moments import moments, moments_of
from imapper_prob.results.report_parts import (
    cross,
    details,
    dots,
    folded,
    heading,
    legend,
    line,
    notes,
    numbers,
    page,
    paragraph,
    patch,
    plot,
    section,
    shades,
    table,
)
from imapper_prob.results.report_plots import (
    CHAIN_COLOURS,
    HIDDEN_COLOURS,
    SEEN_COLOUR,
    SIGHT_COLOUR,
    Floor,
    chains_plot,
    floor_plot,
    hiding_plot,
    hue,
    line_of_object,
    map_plot,
    person_colour,
    view_plot,
)
from imapper_prob.results.report_text import (
    answer,
    caption,
    listed,
    runner_up,
    sides_of,
    trust,
    warnings_of,
)
from imapper_prob.sampling.ensembles import describe_refinement
from imapper_prob.uncertainty.checks import alarms
from imapper_prob.uncertainty.clusters import cells_of_object, names_of
from imapper_prob.uncertainty.parameters import cells_of_parameter
from imapper_prob.uncertainty.scenes import WeightedScene
from imapper_prob.uncertainty.tree import seconds_of

__all__ = ["report", "write_report"]

_ASKED: Final = 3
"""Number of questions on the page."""


def write_report(path: Path, posterior: Posterior) -> None:
    """Write the report as one HTML file, atomically.

    Parameters
    ----------
    path : Path
    posterior : Posterior
    """
    with written_whole(path) as beside:
        beside.write_text(report(posterior), encoding="utf-8")


def report(posterior: Posterior) -> str:
    """Make the page as text, with plots, numbers and scripts inside.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    str
        HTML.
    """
    clip, samples, scenes = posterior.clip, posterior.samples, posterior.scenes()
    floor = Floor.of(clip, scenes)
    wrong = alarms(posterior.checks)
    return page(
        f"{clip.name}: furniture behind a motion",
        [
            heading(_title(posterior)),
            notes(wrong),
            paragraph(answer(scenes), style="answer"),
            paragraph(runner_up(scenes)),
            _trust_of(posterior),
            *([paragraph(posterior.told.text)] if posterior.told is not None else []),
            notes(
                warnings_of(
                    clip,
                    samples,
                    scenes,
                    lost=1 - float(posterior.solution.problem.used.any(1).mean()),
                    clusters=posterior.certainty.clusters,
                    disputed=posterior.disputed,
                )
            ),
            numbers("moments", moments(posterior)),
            _scenes(posterior, floor),
            _objects(posterior, floor),
            _hiding(posterior),
            _questions(posterior),
            _person(posterior),
            _diagnostics(posterior),
            _provenance(posterior),
        ],
    )


def _trust_of(posterior: Posterior) -> str:
    checks = posterior.checks
    said = trust(posterior.samples, alarmed=len(alarms(checks)), checked=len(checks))
    return paragraph(said, style="verdict" if posterior.converged else "verdict doubt")


def _title(posterior: Posterior) -> str:
    """Clip, duration and number of draws."""
    clip, (chains, draws) = posterior.clip, posterior.samples.shape
    people = f"{len(clip.tracks)} people, " if len(clip.tracks) > 1 else ""
    return (
        f"{clip.name} · {people}{clip.n_frames} frames, {clip.n_frames / clip.fps:.0f} s · "
        f"{chains} chains of {draws} draws"
    )


def _scenes(posterior: Posterior, floor: Floor) -> str:
    scenes, clip = posterior.scenes(), posterior.clip
    buttons = "".join(
        f'<button type="button" data-scene="{k}" aria-pressed="{str(not k).lower()}">'
        f"Scene {k + 1}: {escape(as_probability(weighted.probability))}</button>"
        for k, weighted in enumerate(scenes)
    )
    captions = _of_scenes([paragraph(caption(k, w)) for k, w in enumerate(scenes, 1)])
    legends = _of_scenes([_legend_of_scene(clip, weighted) for weighted in scenes])
    last = len(moments_of(clip)) - 1
    player = (
        '<div class="player"><button type="button" id="play">Play</button>'
        f'<input type="range" id="time" min="0" max="{last}" value="0" step="1" '
        'aria-label="Time"><output id="now" for="time"></output></div>'
    )
    width, height = clip.camera.width, clip.camera.height
    above = plot(
        "floor", floor_plot(floor, clip, scenes), proportion=floor.proportion, title="From above",
        alt="The chosen scene from above, with everybody at the chosen time",
    )  # fmt: skip
    view = plot(
        "view", view_plot(clip, scenes), proportion=width / height, title="As the camera sees it",
        alt="Furniture of the chosen scene and joints in the image at the chosen time",
    )  # fmt: skip
    seen = legend(
        [
            (cross(SEEN_COLOUR), "detected joint, pale where unsure"),
            *_people(clip, "person in this scene"),
            (shades(*HIDDEN_COLOURS), "joint, from surely seen to surely hidden, over all draws"),
        ]
    )
    return section(
        "Which rooms",
        f'<div class="choice">{buttons}</div>',
        player,
        captions,
        f'<div class="pair"><div class="card">{above}{legends}</div>'
        f'<div class="card">{view}{seen}<p id="hidden-now"></p></div></div>',
        folded("All scenes in a table, and what each chain says of them", _scene_table(posterior)),
        hint="Choose a scene, and move the slider or press Play to see the person move. The "
        "number of a scene is its probability.",
    )


def _of_scenes(pieces: Sequence[str]) -> str:
    """Pieces by scene, of which only that of the selected scene is visible."""
    return "".join(
        f'<div data-scene="{k}"{" hidden" if k else ""}>{piece}</div>'
        for k, piece in enumerate(pieces)
    )


def _scene_table(posterior: Posterior) -> str:
    scenes = posterior.scenes()
    rows = [
        [
            str(number),
            listed(weighted.names),
            weighted.difference or "the most probable one",
            with_error(weighted.probability, weighted.error),
            *map(as_probability, posterior.scene_probabilities.by_chain[:, number - 1].tolist()),
        ]
        for number, weighted in enumerate(scenes, 1)
    ]
    chains = [f"chain {n}" for n in range(1, posterior.samples.shape[0] + 1)]
    rest = max(1 - sum(weighted.probability for weighted in scenes), 0.0)
    return table(
        ["scene", "furniture", "unlike the first", "probability", *chains],
        rows,
        words=3,
        caption=f"All other scenes together: {as_probability(rest)}. Where chains differ, the "
        "sampler has not found its way between rooms.",
    )


def _people(clip: Clip, what: str) -> list[tuple[str, str]]:
    """Legend entries, one per person."""
    if len(clip.tracks) == 1:
        return [(line(person_colour(0), width=3), what)]
    return [
        (line(person_colour(k), width=3), f"{track.name}, {what}")
        for k, track in enumerate(clip.tracks)
    ]


def _legend_of_scene(clip: Clip, weighted: WeightedScene) -> str:
    entries = [(patch(hue(o.label)), o.label) for o in weighted.objects]
    if entries:
        entries.append((line(INK, dash="dot"), "holds the middle of an object with 90 %"))
    entries += _people(clip, "pelvis, and the person now")
    entries.append((line(QUIET, width=1), "pelvis in other draws"))
    entries.append((line(SIGHT_COLOUR, dash="dash", width=1), "edge of the floor in sight"))
    if clip.truth is not None and clip.truth.objects:
        entries.append((line(QUIET, dash="dash"), "what really was there (a box)"))
    return legend(entries)


def _questions(posterior: Posterior) -> str:
    """The questions whose answers would tell most about the layout."""
    asked = [question for question in posterior.questions()[:_ASKED] if question.bits > 0]
    if not asked:
        return ""
    rows = [[q.text, with_error(q.bits, q.error)] for q in asked]
    return section(
        "What would settle it",
        table(["question", "bits"], rows, words=1),
        hint="By how much an answer would lower the entropy of layouts, on average. The answer "
        "goes into a file for imapper-prob ask.",
    )


def _objects(posterior: Posterior, floor: Floor) -> str:
    certainty, clip = posterior.certainty, posterior.clip
    hidden, clusters = certainty.hidden, certainty.clusters
    rows = [
        [name, *cells_of_object(cluster), f"{(hidden.by_object[k] >= HIDDEN).sum()}"]
        for k, (name, cluster) in enumerate(zip(names_of(clusters), clusters, strict=True))
    ]
    columns = [
        "object", "what it is called", "there", "right [m]", "away [m]", "facing", "hides joints",
    ]  # fmt: skip
    best = posterior.scenes(1)[0].scene.joints[:, PELV, :2]
    where = plot(
        "map",
        map_plot(floor, certainty.occupancy, clusters, by_person(clip, best)),
        alt="Map of the floor: probability that furniture stands there",
        proportion=floor.proportion,
    )
    entries = [(patch(hue(c)), c) for c in certainty.occupancy.categories]
    entries += [
        (line(INK), "holds the middle of an object with 50 %, if it is there"),
        (line(INK, dash="dot"), "with 90 %"),
        (dots(QUIET), "middle of an object in one draw"),
        (line(INK, width=1), "pelvis in the most probable scene"),
    ]
    return section(
        "Where things stand, over all draws",
        f'<div class="card map">{where}{legend(entries)}</div>',
        table(
            columns,
            rows,
            words=2,
            caption='± are standard deviations, of "there" the Monte-Carlo error. The last column '
            "counts joints, over all frames, that the object hides with a probability of at least "
            f"{HIDDEN:.1f}.",
        ),
        hint="Objects matched across all scenes, so that none of this depends on which of them "
        "is the right one. The stronger a colour, the more probably the floor is covered there: "
        "point at it to be told by what, and at a diamond for the object.",
    )


def _hiding(posterior: Posterior) -> str:
    clip, hidden = posterior.clip, posterior.certainty.hidden
    people = len(clip.tracks)
    picture = plot(
        "hiding",
        hiding_plot(clip, hidden, moments_of(clip)),
        alt="Probability that each joint is hidden, by frame, and how many joints objects hide",
        proportion=1.6 / people,
        lowest=460 * people,
    )
    entries = [(shades(*HIDDEN_COLOURS), "joint, from surely seen to surely hidden")]
    for number, name in enumerate(names_of(hidden.clusters)):
        colour, dash = line_of_object(hidden.clusters, number)
        entries.append((line(colour, dash=dash), f"joints that {name} hides"))
    entries.append((line(INK), "time of the slider"))
    return section(
        "What hides what, and when",
        f'<div class="card">{picture}{legend(entries)}</div>',
        hint="Over all draws. Click at a frame to move the slider there.",
    )


def _person(posterior: Posterior) -> str:
    clip, certainty = posterior.clip, posterior.certainty
    pelvis = 100 * certainty.joints.standard_deviation.mean((0, 1))
    rows = [list(cells_of_parameter(one)) for one in certainty.nuisances.values()]
    return section(
        "The person and the camera",
        paragraph(
            f"Joints are known to {pelvis[0]:.0f} cm across the view, {pelvis[1]:.0f} cm in depth "
            f"and {pelvis[2]:.0f} cm in height (standard deviation, mean over joints and frames)."
        ),
        *map(paragraph, sides_of(clip, posterior.sides_flipped)),
        table(
            ["", "from the feet alone", "from everything", "variance less by"],
            rows,
            caption="Camera and body are first fitted to the feet alone, then drawn given "
            "everything that is seen. Where the variance is not less, only the feet and what was "
            "said or assumed tell of the number.",
        ),
    )


def _checks(posterior: Posterior) -> str:
    rows = [
        [check.name, "yes" if check.alarmed else "no", check.sentence] for check in posterior.checks
    ]
    return table(
        ["check", "alarmed", "what was found"],
        rows,
        words=3,
        caption="Of clips that are as the model says, each of the first six is alarmed by one in "
        "a hundred.",
    )


def _diagnostics(posterior: Posterior) -> str:
    samples = posterior.samples
    table_of_moves = [
        [
            name,
            str(samples.acceptance.proposed[name]),
            str(samples.acceptance.accepted[name]),
            f"{100 * rate:.1f} %",
        ]
        for name, rate in samples.acceptance.rates().items()
    ]
    ladders = [
        [
            f"chain {number}",
            str(ladder.round_trips),
            f"{min(ladder.swap_rates):.2f} to {max(ladder.swap_rates):.2f}",
        ]
        for number, ladder in enumerate(samples.ladders, 1)
        if ladder.swap_rates and math.isfinite(ladder.barrier)
    ]
    evidence = None if posterior.told is None else posterior.told.evidence
    weighted = evidence is not None and evidence.method == "reweighted"
    chains = plot(
        "chains",
        chains_plot(
            samples.traces, unused=samples.unused(posterior.config.sample, weighted=weighted)
        ),
        alt="Log-posterior of every chain over the run",
        proportion=2.6,
    )
    entries = [
        (line(CHAIN_COLOURS[k % len(CHAIN_COLOURS)]), f"chain {k + 1}")
        for k in range(len(samples.traces))
    ]
    return section(
        "How far to trust it",
        _trust_of(posterior),
        paragraph(
            "Two things can be wrong. The sampler may have stopped too early: then runs that "
            "began apart differ, and more steps help. Or the clip is not what the model takes it "
            "for, a wrong camera or a bad detector: then all runs agree on nonsense, and only "
            "the checks tell."
        ),
        folded("Does clip, camera and library go together? The checks", _checks(posterior)),
        folded(
            "Do the chains agree? The numbers",
            paragraph(posterior.chain_verdict),
            paragraph(describe_refinement(samples.walked)),
            f'<div class="card">{chains}{legend(entries)}</div>',
            paragraph(
                "After the grey part, from which no draws are used, all chains should look alike, "
                "and none should drift.",
                style="hint",
            ),
            table(
                ["move", "proposed", "accepted", "rate"],
                table_of_moves,
                caption="A step of a chain proposes a change, which is accepted or not. Redraws "
                "add and remove scenelets.",
            ),
            *(
                [
                    table(
                        ["", "round trips", "swap rates"],
                        ladders,
                        caption="Tempering: journeys from the hottest to the coldest and back.",
                    )
                ]
                if ladders
                else []
            ),
        ),
    )


def _provenance(posterior: Posterior) -> str:
    said = posterior.data.attrs
    rows = [
        ["program", str(said["program"])],
        ["clip", f"{said['clip']} (SHA-256 {said['clip_digest'][:16]})"],
        ["library", f"{said['library']} (SHA-256 {said['library_digest'][:16]})"],
        ["settings", f"seed {said['seed']} (SHA-256 {said['config_digest'][:16]})"],
        *([name, f"{value:.1f} s"] for name, value in seconds_of(said).items()),
    ]
    return section(
        "Where this is from",
        table(["", ""], rows, words=2),
        details("All settings, to repeat the run", str(said["config"])),
    )
