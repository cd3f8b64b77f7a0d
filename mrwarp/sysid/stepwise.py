"""Which causes a plant has: a model grown one by one, then what is not certain taken out of it."""

from __future__ import annotations

from collections.abc import Callable

from mrwarp.sysid.plant import Candidate, Cause, Certainty, Model, Named, Plant


def searched(plant: Plant[Model, Candidate, Cause]) -> Model:
    """The model whose causes all are certain: forward selection, then backward elimination."""
    model = plant.base
    while candidates := plant.candidates(model):
        if (more := plant.grown(model, candidates)) is None:
            break
        model = more
    model = plant.settled(model)
    for certainty in plant.tests:
        model, _ = eliminated(plant, model, certainty)
    return model


def eliminated(
    plant: Named[Model, Cause],
    model: Model,
    certainty: Certainty[Model],
    *,
    together: Callable[[list[Cause]], list[Cause]] = lambda weakest: weakest[:1],
) -> tuple[Model, list[Cause]]:
    """Backward elimination: the least certain cause goes and the others are judged without it, until all are certain.

    Args:
        plant: What names causes and takes one out.
        model: The model.
        certainty: Of each of the causes that are left.
        together: Which go at a time, of those that are not certain, the least certain first.

    Returns:
        The model with the causes that stay, and those that went, in the order in which they did.
    """
    gone = list[Cause]()
    while causes := plant.causes(model):
        certain = certainty(model)
        order = sorted(range(len(causes)), key=lambda k: certain[k])
        weakest = [causes[k] for k in order if not certain[k] >= 1.0]
        if not weakest:
            break
        for one in together(weakest):
            model = plant.without(model, one)
            gone.append(one)
    return model, gone
