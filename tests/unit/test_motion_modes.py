"""Motion modes of beds whose every particle moves as told: each criterion is then known in closed form."""

import math

import numpy as np
import pytest

from graindamp.campaign.point import LOSSES
from graindamp.campaign.point import NO_CRITERIA as NO_POINT_CRITERIA
from graindamp.errors import InputError
from graindamp.field.schema import make_field
from graindamp.report import mode_figures
from graindamp.report.field_pictures import write_pictures
from graindamp.report.figures import save
from graindamp.report.simulation import examine, mode_table, simulation_document
from graindamp.report.simulation_figures import stirring
from graindamp.signals.motion_modes import (
    NAMES,
    NO_CRITERIA,
    SOLID,
    Criteria,
    MotionMode,
    classify,
    judge,
)
from runs_made import description, made_run, stirred_run

ALONG = np.array([1.0, 0.0, 0.0])
TAU = 2.0 * np.pi


def glued(turn):
    return 0.0 * ALONG, 0.0


def at_rest(turn):
    """The container moves with V cos and X sin beside a bed that does not."""
    return -math.cos(TAU * turn) * ALONG, -math.sin(TAU * turn)


def bouncing(turn):
    """Plastic block at X = X_opt: it leaves one end with V, meets the other half a cycle later, and so back."""
    own = 1.0 if turn < 0.5 - 1e-9 else -1.0  # at half a cycle it has been hit, at the end not yet
    place = TAU * turn if turn < 0.5 else TAU * (1.0 - turn)
    return (own - math.cos(TAU * turn)) * ALONG, place - math.sin(TAU * turn)


def blows(turn):
    """An impact on the far end at half a cycle, on the near one at its end, each within one block."""
    return 40.0 * (turn > 39 / 40), 40.0 * (0.5 <= turn < 0.5 + 1 / 40)


def sliding(ratio):
    """Block on a floor with Coulomb friction, ratio = Gamma / mu, that always slips: its own velocity is a triangle.

    It turns where its velocity is that of the container, falling through -pi / (2 ratio) V."""
    least = math.pi / (2.0 * ratio)
    begin = 1.0 - math.acos(-least) / TAU

    def bed(turn):
        late = (turn - begin) % 1.0
        own = least * (4.0 * late - 1.0 if late < 0.5 else 3.0 - 4.0 * late)
        return (own - math.cos(TAU * turn)) * ALONG, 0.0

    return bed


def test_a_bed_that_clings_is_solid():
    verdict = classify(stirred_run(glued))
    c = verdict.criteria
    assert verdict.mode == MotionMode.SOLID_LIKE
    assert c.relative_energy == 0.0
    assert c.moving == 0.0
    assert c.absolute_energy == pytest.approx(0.5, rel=1e-12)
    assert c.inertial_speed == pytest.approx(1.0, rel=1e-12)
    assert c.travel == pytest.approx(0.0, abs=1e-12)
    assert math.isnan(c.indentation)


def test_a_bed_at_rest_is_decoupled():
    verdict = classify(stirred_run(at_rest))
    c = verdict.criteria
    assert verdict.mode == MotionMode.DECOUPLED
    assert c.relative_energy == pytest.approx(0.5, rel=1e-12)
    assert c.cohesion == pytest.approx(1.0, rel=1e-12)
    assert c.absolute_energy == pytest.approx(0.0, abs=1e-12)
    assert c.inertial_speed == pytest.approx(0.0, abs=1e-12)
    assert c.stroke_travel == pytest.approx(1.0, rel=1e-3)  # block means of 1/200 cycle shorten the measured stroke
    assert c.travel == pytest.approx(2.0 / math.pi, rel=1e-3)
    assert c.lowest_speed == pytest.approx(math.sqrt(0.5), rel=1e-12)


def test_a_plastic_block_bounces():
    """Relative energy 1 + 1/2, less nothing: the block's square wave is in quadrature with the container."""
    verdict = classify(stirred_run(bouncing, blows))
    c = verdict.criteria
    assert verdict.mode == MotionMode.BOUNCING
    assert c.relative_energy == pytest.approx(1.5, rel=1e-9)
    assert c.absolute_energy == pytest.approx(1.0, rel=1e-9)
    assert c.cohesion == pytest.approx(1.0, rel=1e-12)
    assert c.travel == pytest.approx(1.0, rel=1e-3)
    assert c.impacts == 2.0
    assert c.sharpness == pytest.approx(1.0, rel=1e-12)
    assert c.contact == pytest.approx(1.0 / 40.0, rel=1e-12)


@pytest.mark.parametrize("lead", [0.0, 0.25, 0.6])
def test_phases_are_those_of_the_container(lead):
    """Whatever the phase that a run begins with, the far end is hit where the container is fastest backwards."""
    stirring = stirred_run(at_rest, blows, lead=lead).stirring
    block = TAU / 80.0  # half a block
    inner = slice(1, -1)  # a blow in the last block of a cycle may fall into the next
    assert np.allclose(np.abs(stirring.end_phase[inner, 1]), np.pi - block, atol=1e-9)
    assert np.allclose(stirring.end_phase[inner, 0], -block, atol=1e-9)
    assert np.allclose(stirring.end_impulse[inner], TAU, rtol=1e-3)  # 40 m A over a fortieth of a cycle, over m V


@pytest.mark.parametrize("ratio", [2.0, 3.0, 10.0])
def test_a_block_that_slides(ratio):
    """Energies 1/2 (pi / 2 ratio)^2 * 2/3 at rest, and 1/2 + that - m' in the container, with m' = 2 / ratio^2.

    Twenty samples of a triangle with corners between them: the mean of its square is off by (1/20)^2 of it, and the
    correlation by as much."""
    c = classify(stirred_run(sliding(ratio))).criteria
    rest = math.pi**2 / (12.0 * ratio**2)
    assert c.absolute_energy == pytest.approx(rest, abs=0.01 * rest + 1e-9)
    assert c.relative_energy == pytest.approx(0.5 + rest - 2.0 / ratio**2, abs=0.01)
    assert c.inertial_speed == pytest.approx(math.sqrt(2.0 * rest), rel=0.01)
    assert c.cohesion == pytest.approx(1.0, rel=1e-12)


def test_sliding_is_decoupled_only_far_above_friction():
    """1.28 mu / Gamma = 0.15 at Gamma = 8.6 mu."""
    assert classify(stirred_run(sliding(2.0))).mode == MotionMode.LOCAL_FLUIDIZATION
    assert classify(stirred_run(sliding(4.0))).mode == MotionMode.GLOBAL_FLUIDIZATION
    assert classify(stirred_run(sliding(12.0))).mode == MotionMode.DECOUPLED


def test_the_limit_of_solid_beds_is_that_of_a_loss_factor_of_a_tenth():
    """Stick and slip of a Coulomb block, integrated in time: where eta = 0.1 its relative energy is SOLID."""

    def block(ratio, n=20_000):
        turn = TAU * np.arange(3 * n) / n
        own, speed, power, energy = math.cos(0.0), np.cos(turn), 0.0, 0.0
        for k in range(3 * n):
            step = (TAU / n) / ratio
            before = speed[k] - own
            force = min(max(before, -step), step)  # what friction can change in a step, or all there is
            own += force
            if k >= 2 * n:
                power += force * 0.5 * (before + (speed[k] - own))
                energy += (speed[k] - own) ** 2 / n
        return power / math.pi, energy  # eta = E / (pi m V^2); energy over m V^2 / 2

    loss, energy = np.array([block(ratio) for ratio in (1.2, 1.22, 1.24, 1.26, 1.28, 1.3)]).T
    assert loss[0] == pytest.approx(0.069, rel=0.05)  # closed form of the reference sheet, Gamma = 1.2 mu
    assert np.interp(0.1, loss, energy) == pytest.approx(SOLID, rel=0.2)  # stated to one digit


def test_only_the_top_moves():
    """The highest third stays behind, the rest clings: a sixth of m V^2 / 2."""

    def bed(turn):
        velocity = np.zeros((90, 3))
        velocity[highest, 0] = -math.cos(TAU * turn)
        return velocity, 0.0

    highest = np.argsort(stirred_run(glued).packing.position[:, 2], kind="stable")[60:]
    verdict = classify(stirred_run(bed))
    assert verdict.mode == MotionMode.LOCAL_FLUIDIZATION
    assert verdict.criteria.relative_energy == pytest.approx(1.0 / 6.0, rel=1e-9)
    assert verdict.criteria.moving == pytest.approx(1.0 / 3.0)
    assert verdict.criteria.lowest_speed < 0.2  # a tie in height may put a few of the top below
    assert verdict.criteria.highest_speed > 0.6


def test_rattling_about_a_centre_at_rest_is_fluid():
    """Particles stay with their centre beside the container and rattle at V each way."""

    def bed(turn):
        rattle = np.where(np.arange(90)[:, None] % 2, 1.0, -1.0) * math.sin(TAU * turn)
        return -math.cos(TAU * turn) * ALONG + rattle * np.array([0.0, 0.0, 1.0]), 0.0

    verdict = classify(stirred_run(bed))
    assert verdict.criteria.inertial_speed == pytest.approx(0.0, abs=1e-9)
    assert verdict.criteria.absolute_energy == pytest.approx(0.5, rel=1e-9)
    assert verdict.mode == MotionMode.GLOBAL_FLUIDIZATION


def test_coated_ends_that_are_pressed_in():
    spec = description(90)
    tables = spec.model_dump(mode="json")
    coating = {"youngs_modulus": 0.72e6, "poisson_ratio": 0.5, "thickness": 3e-3}
    tables["damper"]["container"]["walls"] = {"start": {"coating": coating}, "end": {"coating": coating}}
    coated = type(spec).model_validate(tables)

    def bed(turn):
        return 0.8 * -math.sin(TAU * turn) * ALONG, 0.8 * (math.cos(TAU * turn) - 1.0)

    run = stirred_run(bed, spec=coated)
    c = classify(run).criteria
    assert c.indentation == pytest.approx(1.6, rel=1e-3)  # spheres that touch the end at turn 0, moved by 1.6 X
    assert classify(run).mode == MotionMode.COMPRESSION
    assert np.all(run.stirring.compression[:, 1] == 0.0)


def test_a_bed_that_still_slumps_is_unknown():
    """Speed that dies away and does not change sign within a cycle: none of it is the container's doing."""
    count = iter(range(10_000))

    def bed(turn):
        return 3.0 * math.exp(-next(count) / 30.0) * np.array([0.0, 1.0, 0.0]), 0.0

    verdict = classify(stirred_run(bed))
    assert verdict.mode == MotionMode.UNKNOWN
    assert verdict.criteria.decay < 0.1


def test_without_a_record_nothing_is_said():
    verdict = classify(made_run(n_snapshot=0))
    assert verdict.mode == MotionMode.UNKNOWN
    assert all(math.isnan(value) for value in verdict.criteria)
    assert not verdict.is_close
    assert len(NO_POINT_CRITERIA) == len(Criteria._fields)
    assert set(NAMES) == set(MotionMode)


def test_close_verdicts_say_so():
    base = NO_CRITERIA._replace(
        relative_energy=0.5, absolute_energy=0.4, cohesion=0.5, flow=0.1, decay=1.0, inertial_speed=0.7,
        lowest_speed=0.49, highest_speed=0.9, travel=0.1,
    )  # fmt: skip
    assert judge(base).mode == MotionMode.LOCAL_FLUIDIZATION
    assert judge(base).is_close
    assert not judge(base._replace(lowest_speed=0.2)).is_close
    assert judge(base._replace(lowest_speed=0.51)).mode == MotionMode.GLOBAL_FLUIDIZATION


def _field(**variables):
    f, gamma = np.geomspace(40.0, 1000.0, 5), np.geomspace(1.0, 40.0, 4)
    eta = np.full((5, 4), 0.3)
    return make_field(
        f, gamma, eta, eta, 0.03, source="made", damper={"name": "made", "clearance": 3e-3}, variables=variables
    )


def test_a_map_names_the_modes_that_are_there(tmp_path):
    modes = np.arange(20).reshape(5, 4) % 4 - 1
    figure = mode_figures.mode_map(_field(motion_mode=modes))
    legend = figure.legends[0]
    assert [text.get_text()[:1] for text in legend.get_texts()] == ["?", "S", "L", "G"]
    letters = [text.get_text() for text in figure.axes[1].texts]
    assert sum(letter == "L" for letter in letters) == int(np.sum(modes == MotionMode.LOCAL_FLUIDIZATION))
    assert any("h/π" in letter for letter in letters)
    assert set(mode_figures.MARKS) == set(MotionMode)
    assert save(figure, tmp_path / "map.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="no motion_mode"):
        mode_figures.mode_map(_field())


def test_pictures_are_those_that_a_field_knows(tmp_path):
    modes, share = np.arange(20).reshape(5, 4) % 4 - 1, np.full((5, 4), 0.5)
    whole = _field(motion_mode=modes, loss_share_normal=share, loss_share_friction=share)
    written = write_pictures(whole, tmp_path / "whole")
    assert [one.name for one in written] == ["modes", "losses"]
    assert [one.path.name for one in written] == ["whole.modes.png", "whole.losses.png"]
    assert all(one.path.read_bytes().startswith(b"\x89PNG") for one in written)
    assert write_pictures(_field(), tmp_path / "typed") == ()
    still = _field(loss_share_normal=0.0 * share)
    assert write_pictures(still, tmp_path / "still") == ()
    gaps = _field(loss_share_normal=share, loss_share_friction=np.full((5, 4), np.nan))
    assert write_pictures(gaps, tmp_path / "gaps") == ()
    column = np.full((5, 4), np.nan)
    column[2] = 0.5
    assert write_pictures(_field(loss_share_normal=column), tmp_path / "column") == ()
    f, some = np.array([10.0, 100.0, 1000.0]), np.full(3, 0.3)
    modes = {"motion_mode": np.zeros(3)}
    diagonal = make_field(f, f / 10.0, some, some, 0.03, source="made", scattered=True, variables=modes)
    assert write_pictures(diagonal, tmp_path / "diagonal") == ()
    assert write_pictures(whole.isel(intensity=[0]), tmp_path / "line") == ()


def test_shares_of_what_is_dissipated(tmp_path):
    share = np.full((6, len(LOSSES)), np.nan)
    share[:5] = [0.5, 0.2, 0.2, 0.1, 0.0, 0.0]
    f = np.array([50.0, 50.0, 50.0, 100.0, 100.0, 100.0])
    shares = mode_figures.LossShares(f, np.array([1.0, 5.0, 20.0, 1.0, 5.0, 20.0]), share)
    figure = mode_figures.loss_shares(shares, [48.0])
    assert [axes.get_title() for axes in figure.axes] == ["50 Hz"]
    assert len(figure.legends[0].get_texts()) == 4  # mechanisms that take no part are not listed
    assert len(mode_figures.loss_shares(shares).axes) == 2
    assert save(mode_figures.loss_share_maps(shares, 3e-3), tmp_path / "maps.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="loss_share_normal"):
        mode_figures.shares_of_field(_field())


def test_an_energy_path_tells_joules_per_cycle(tmp_path):
    run = stirred_run(glued)
    texts = [text.get_text() for text in mode_figures.energy_path(run).axes[0].texts]
    assert sum("J" in text for text in texts) == len(texts) >= 4
    assert any("impacts between particles" in text and "50 %" in text for text in texts)


def test_velocity_fields_share_a_scale(tmp_path):
    run = made_run()
    figure = mode_figures.velocity_fields({"one": run, "two": run}, offset=2e-3)
    assert [axes.get_title() for axes in figure.axes[:2]] == ["one", "two"]
    assert save(figure, tmp_path / "fields.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="at 500 mm beside the middle plane are visited by fewer than"):
        mode_figures.velocity_fields({"one": run}, offset=0.5)
    with pytest.raises(InputError, match="velocity field"):
        mode_figures.velocity_fields({"one": run._replace(velocity_field=None)})


def test_a_report_tells_the_mode(tmp_path):
    result = examine(stirred_run(at_rest, n_cycle=30))
    assert mode_table(result.verdict).rows[0] == ("motion mode", "decoupled")
    document = simulation_document(result)
    assert document["motion_mode"] == "decoupled"
    assert document["motion_criteria"]["cohesion"] == pytest.approx(1.0)
    assert document["motion_criteria"]["indentation"] is None
    figure = stirring(result.run, result.verdict)
    assert "decoupled" in figure.get_suptitle()
    assert save(figure, tmp_path / "stirring.png").stat().st_size > 10_000
