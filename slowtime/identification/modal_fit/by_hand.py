"""Modes of a modal test as a person chose them among the automatic ones and their diagram."""

import dataclasses

import numpy as np

from slowtime.identification.options import Edit, Selection
from slowtime.identification.selection import plan_edits

from .assembly import ModalTest, assemble_test
from .maximum_likelihood import PoleFit, fit_poles
from .mode_choice import enlarged_by_student, noise_of_fit

STRAYED = 2.0
"""Distance of a fit from the pole chosen above which it is another mode [half-bandwidths]."""


def edited_test(test: ModalTest, selection: Selection) -> ModalTest:
    """Edit the automatic choice of a modal test as a person says.

    Modes by hand are fitted together with all others that are not replaced, whether or not
    these are reported.

    Raises `ValueError` where an edit names no mode or pole, or the data have no mode at a pole
    that is kept.
    """
    before = test.candidates
    known = [
        dataclasses.replace(one, pole=complex(pole))
        for one, pole in zip(
            before.chosen, [] if test.fit is None else test.fit.poles, strict=True
        )
    ]
    plan = plan_edits(selection, known, before.poles)
    named = [
        (one, "", k not in plan.hidden) for k, one in enumerate(known) if k not in plan.replaced
    ]
    named += [(one, flag, True) for one, flag in plan.added]
    named.sort(key=lambda item: item[0].pole.imag)
    fit = test.fit
    if plan.added or plan.replaced:
        fit = _fitted(test, np.array([one.pole for one, _, _ in named]))
        for one, pole in zip((item[0] for item in named), fit.poles, strict=True):
            if abs(pole - one.pole) > STRAYED * abs(one.pole.real):
                edit = Edit(action="keep", at_hz=(one.frequency_hz,))
                raise ValueError(
                    f"{edit}: the responses have no mode there; its fit ends at "
                    f"{abs(pole) / (2 * np.pi):.5g} Hz. Choose another pole, or none."
                )
    candidates = dataclasses.replace(before, chosen=[one for one, _, _ in named])
    whole = assemble_test(test.response, candidates, fit, test.driving_points)
    modes = [
        dataclasses.replace(mode, flags=(*mode.flags, *((flag,) if flag else ())))
        for mode, (_, flag, _) in zip(whole.result.modes, named, strict=True)
    ]
    shown = [k for k, item in enumerate(named) if item[2]]
    result = dataclasses.replace(
        whole.result,
        modes=tuple(modes[k] for k in shown),
        stabilisation=whole.result.stabilisation.of_modes(shown),
        notes=selection.notes,
    )
    return dataclasses.replace(
        whole, result=result, constants=tuple(whole.constants[k] for k in shown)
    )


def _fitted(test: ModalTest, poles: np.ndarray) -> PoleFit:
    data = test.candidates.data
    fit = fit_poles(data, poles)
    if test.candidates.is_noise_fitted:
        fit = enlarged_by_student(fit, noise_of_fit(data, fit))
    return fit
