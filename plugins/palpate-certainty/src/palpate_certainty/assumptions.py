"""Numbers that the intervals assume, each with its evidence."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Numbers of the error budget that no study states.

    The first six are usual errors of an experiment, where neither the study nor its files state them. The
    others are shapes of errors. Three have a measured value each, at spots that chose nothing, in
    ``benchmarks/README.md#stated-against-true-error-by-the-mesh``; the effect of all on regions and intervals
    is in ``benchmarks/README.md#coverage-by-finite-elements``.

    Parameters
    ----------
    onset_mm : float
        Standard deviation of the onset of contact.
    position_mm, bone_mm : float
        Standard deviations of a spot's position along the skin, and of the depth of the bones.
    relative : float
        Standard deviation of a layer, over its thickness, and of friction and of fixed and tied parameters of
        simulated data, over their values. A fixed parameter goes no farther than its physical range.
    borrowed : float
        The same of measured data: values of other tissue. Chosen on even seeds of ``bench_laws.py --tied``.
    skin_friction : float
        Standard deviation of a friction coefficient on skin, over its value: person and humidity change it.
    extrapolation : float
        Standard deviation of an extrapolation by two meshes, over its change of the finer mesh's curve. All
        curves of all spots share one amplitude: their meshes are made alike. Of torque, measured: 0.73 at the
        spots that chose it, and 0.83 at the others.
    contact : float
        Standard deviation of a correction by a rigid contact, over that correction. Twice the penalty at one
        press: 0.1 off for the force, 0.5 and more for the torque.
    mesh_shared : float
        Share of the variance of a mesh's other errors that all presses have in common. Measured: 0.08 of
        force, 0.65 of torque.
    mesh_along : float
        Part of these errors that varies along the path, over the part in proportion to the curve. Measured:
        0.41 of force, 0.70 of torque.
    unseen_length : float
        Correlation length, in ranges of the abscissa, of a model error that the residuals do not show. No
        measurement has it alone.
    common : float
        Share of a discrepancy's variance that all spots have in common, where too few of them tell.
    discrepancy_lengths : tuple of float
        Correlation lengths of the discrepancy that are tried, in ranges of the abscissa.
    longest_noise : float
        Longest correlation of noise, in ranges of the abscissa: what is longer is discrepancy.
    not_excluded : float
        Probability of a discrepancy that is no larger than the one of a model that differs from the curves by
        more than its stated errors; such a model is fitted by Fopt's weights. Evidence: the second presses in
        ``benchmarks/evidence.md#other-laws-and-spots``.
    law_length, larger : float
        Correlation length of a discrepancy that a test of the residuals looks for, and the weight that it
        gives larger stated errors. Chosen on even seeds of the same worlds.
    scale_freedom : float
        Degrees of freedom of the inverse-gamma prior on the scale of all stated errors, which is 1. Tested
        by the regions at twice the errors.
    """

    onset_mm: float = 0.05
    position_mm: float = 1.0
    bone_mm: float = 1.0
    relative: float = 0.1
    borrowed: float = 0.5
    skin_friction: float = 0.3
    extrapolation: float = 0.7
    contact: float = 0.3
    mesh_shared: float = 0.8
    mesh_along: float = 0.5
    unseen_length: float = 0.25
    common: float = 0.5
    discrepancy_lengths: tuple[float, ...] = (0.15, 0.35, 0.8)
    longest_noise: float = 0.1
    not_excluded: float = 0.9
    law_length: float = 0.35
    larger: float = 0.3
    scale_freedom: float = 5.0


ASSUMED = Assumptions()
