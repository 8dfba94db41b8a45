"""The family of structures over which the laws of dynamics are tested."""

import numpy as np
import pytest

from slowtime.dynamics.builders import beam, chain
from slowtime.dynamics.damping import modal_damping
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.structure import Structure


def damped(structure, damping):
    return Structure(
        mass=structure.mass,
        damping=damping,
        stiffness=structure.stiffness,
        names=structure.names,
        influence=structure.influence,
        base_mass=structure.base_mass,
    )


def random_chain(dofs, seed):
    rng = np.random.default_rng(seed)
    return chain(
        rng.uniform(1.0, 3.0, dofs).tolist(),
        rng.uniform(500.0, 900.0, dofs).tolist(),
        dampings_n_s_per_m=rng.uniform(0.0, 6.0, dofs).tolist(),
    )


def example_3_3():
    return assemble(chain([1.0] * 3, [1.0] * 4, ground_dampings_n_s_per_m=[0.2] * 3))


def example_3_4():
    return Structure(
        mass=np.eye(2),
        damping=np.array([[4.0, -4.0], [-4.0, 4.0]]),
        stiffness=np.array([[1100.0, -100.0], [-100.0, 1200.0]]),
    )


def example_3_5():
    return assemble(chain([1.0] * 3, [1.0] * 4, ground_dampings_n_s_per_m=[0.2, 0.0, 0.2]))


def modally_damped_chain():
    bare = assemble(random_chain(4, 1))
    ratios = np.array([0.01, 0.02, 0.025, 0.03])
    return damped(bare, modal_damping(bare.mass, bare.stiffness, ratios))


def fitted_beam():
    bare = assemble(beam(2.0, 100.0, 1.5, elements=4, supports="propped", tip_mass_kg=0.5))
    omega = undamped_modes(bare).angular_frequency
    ratios = 0.01 + 0.1 / omega + 1e-5 * omega
    return damped(bare, modal_damping(bare.mass, bare.stiffness, ratios))


def twins():
    """Two equal oscillators side by side: a frequency that occurs twice."""
    return Structure(mass=np.eye(2), damping=0.3 * np.eye(2), stiffness=5.0 * np.eye(2))


FAMILY = {
    "example 3.3": example_3_3,
    "example 3.4": example_3_4,
    "example 3.5": example_3_5,
    "random dampers": lambda: assemble(random_chain(6, 0)),
    "undamped": lambda: damped(assemble(random_chain(5, 2)), np.zeros((5, 5))),
    "modal damping": modally_damped_chain,
    "beam": fitted_beam,
    "two alike": twins,
    "overdamped": lambda: damped(example_3_3(), 4.0 * np.eye(3)),
    "driven": lambda: damped(example_3_3(), np.diag([-0.1, -0.1, -0.1])),
    "partly overdamped": lambda: damped(example_3_3(), np.diag([5.0, 0.1, 0.3])),
}
DEFECTIVE = {
    "critical": lambda: damped(example_3_3(), 2 * np.sqrt(2.0) * np.eye(3)),
    "free to drift": lambda: assemble(chain([1.0, 2.0], [0.0, 30.0], rayleigh=(0.0, 0.01))),
    "drift, odd dampers": lambda: assemble(
        chain([1.0, 2.0, 1.0], [0.0, 30.0, 20.0], dampings_n_s_per_m=[0.0, 1.0, 0.1])
    ),
}


@pytest.fixture(params=FAMILY)
def structure(request):
    """A structure whose modes span all motion."""
    return FAMILY[request.param]()


@pytest.fixture(params=FAMILY | DEFECTIVE)
def any_structure(request):
    """A structure with modes that may coincide, too."""
    return (FAMILY | DEFECTIVE)[request.param]()


@pytest.fixture(params=DEFECTIVE)
def defective(request):
    """A structure whose modes do not span all motion."""
    return DEFECTIVE[request.param]()


@pytest.fixture(scope="session")
def family():
    """Builders of the structures above, by name."""
    return FAMILY | DEFECTIVE
