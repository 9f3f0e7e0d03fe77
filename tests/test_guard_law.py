"""What elements do when they are entered, met, left and moved, in the C guard and in Python."""

from itertools import product

import numpy as np
import pytest

from tests.entered_scenes import made
from tests.guard import Guard, InPython, Reply, built, enter, push
from tune import SafeProfile, export

TAPS = 7
SIZES = {
    "wall": (2000.0, 0.0, 0.0),
    "wall 2": (2000.0, 0.0, 0.0),
    "wall 3": (1000.0, 20.0, 0.0),
    "rubber": (700.0, 10.0, 0.0),
    "water": (0.0, 10.0, 0.0),
    "cup": (0.0, 0.0, 1.0),
    "gum": (300.0, 0.0, 0.5),
}
WALL, OTHER, SOFT, RUBBER, WATER, CUP, GUM = (1 << k for k in range(len(SIZES)))
#: N, at which the clamp of "wall 3" is.
LEVEL = 2.0
Player = Guard | InPython


def scene() -> SafeProfile:
    """Water may be met with rubber and with the cup; the second wall never with the cup."""
    profile = made(
        "homerehab",
        SIZES,
        together=(("rubber", "water"), ("water", "cup")),
        apart=(("wall 2", "cup"),),
        taps=TAPS,
    )
    soft = profile.elements["wall 3"].model_copy(update={"force_level": LEVEL})
    return profile.model_copy(update={"elements": {**profile.elements, "wall 3": soft}}).signed()


@pytest.fixture(scope="module", params=["c", "python"])
def player(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Player:
    if request.param == "python":
        return InPython(scene())
    return built(export(scene(), "c"), tmp_path_factory.mktemp("law"))


class Played:
    """One player with a period that goes on; the device is at rest for a while first."""

    def __init__(self, player: Player, place: float = 0.0) -> None:
        self.player, self.period, self.place = player, 0, place
        player.start()
        self.at(0, place)

    def enter(self, elements: int, rest: float = 0.0, side: int = 0) -> str:
        return self.player.call(enter(elements, rest, side)).status

    def at(self, elements: int, place: float, gain: float = 1.0) -> Reply:
        """The reply to the next reading."""
        self.period += 1
        self.place = place
        return self.player.call(push(elements, self.period, place, gain))

    def stay(self, elements: int, samples: int, gain: float = 1.0) -> list[float]:
        """Forces while the device stands still."""
        return [self.at(elements, self.place, gain).force for _ in range(samples)]

    def to(self, elements: int, place: float, gain: float = 1.0) -> list[float]:
        """Forces on the way to some place, at 0.1 m/s."""
        samples = round(abs(place - self.place) / 1e-4)
        way = np.linspace(self.place, place, samples + 1)[1:].tolist()
        return [self.at(elements, x, gain).force for x in way]


def test_a_wall_is_met_wherever_it_is_and_never_pulls(player: Player) -> None:
    """Its damper pushes 2 mm before its face, B·v = 2 N of 1 N/mm, and pulls nowhere on the way."""
    for side in (1, -1):
        played = Played(player, side * 0.005)
        assert played.enter(SOFT) == "NO_SIDE"
        assert played.enter(SOFT, 0.0, side) == "OK"
        inwards = side * np.array(played.to(SOFT, -side * 1e-3))
        assert not inwards[:30].any()
        assert np.all(inwards[31:] > 0)
        assert inwards.max() == LEVEL
        outwards = side * np.array(played.to(SOFT, side * 0.005))
        assert outwards[0] > 0
        assert outwards.min() == 0
        assert not outwards[3:].any()


def test_a_spring_rests_where_it_is_entered_even_in_motion(player: Player) -> None:
    """It meets a device that moves like a damper: nothing is stored in it."""
    played = Played(player)
    played.enter(RUBBER, 0.5)
    played.to(0, 0.02)
    forces = played.to(RUBBER, 0.021)
    # B·v is 1 N.
    assert forces[0] == pytest.approx(-1.0, abs=1e-3)
    assert forces[0] - forces[1] == pytest.approx(700 * 1e-4, abs=1e-3)
    assert played.stay(RUBBER, 300)[-1] == pytest.approx(-700 * 9e-4)
    # Left and entered again, it rests there.
    assert played.stay(0, 3) == [0.0] * 3
    assert played.stay(RUBBER, 3) == pytest.approx([0.0] * 3, abs=1e-9)
    assert played.to(RUBBER, 0.022)[-1] < -0.7


def test_a_spring_with_a_mass_that_is_entered_in_a_hurry_fades_in(player: Player) -> None:
    """At 5 m/s² its mass would give 2.5 N, a hundredth of it in the first sample."""
    played = Played(player)
    played.enter(GUM)
    way = [2.5e-6 * k * k for k in range(100)]
    forces = [played.at(GUM if k >= 95 else 0, x).force for k, x in enumerate(way)][95:]
    assert 0.0 < -forces[0] < 0.035
    assert -forces[1] < 0.07


def test_a_wall_entered_inside_gives_nothing_and_stands_at_its_face_after_one_was_out(
    player: Player,
) -> None:
    played = Played(player, -0.003)
    assert played.enter(WALL, 0.0, 1) == "OK"
    assert played.stay(WALL, 50) == [0.0] * 50
    assert played.to(WALL, -0.004)[-1] == pytest.approx(2.0)
    assert max(played.to(WALL, 0.0)) == pytest.approx(1.8)
    played.stay(WALL, TAPS - 2)
    # Not quite so long out of it: the wall is where it was entered.
    assert played.to(WALL, -0.002)[-1] == 0.0
    assert played.to(WALL, -0.0035)[-1] == pytest.approx(1.0)
    played.to(WALL, 0.0)
    played.stay(WALL, TAPS - 1)
    assert played.to(WALL, -0.002)[-1] == pytest.approx(4.0)


def test_a_gain_falls_at_once_and_rises_after_as_many_quiet_samples_as_taps(player: Player) -> None:
    played = Played(player)
    played.enter(WALL, 0.0, 1)
    played.stay(WALL, 1)
    assert played.to(WALL, -0.002)[-1] == pytest.approx(4.0)
    assert played.stay(WALL, 1, 0.25) == pytest.approx([1.0])
    assert played.stay(WALL, 50) == pytest.approx([1.0] * 50)
    played.to(WALL, 0.0)
    played.stay(WALL, TAPS - 2)
    assert played.to(WALL, -0.002)[-1] == pytest.approx(1.0)
    played.to(WALL, 0.0)
    played.stay(WALL, TAPS - 1)
    assert played.to(WALL, -0.002)[-1] == pytest.approx(4.0)
    # Left and entered again, it has the gain of its entry, and rests where that was.
    played.stay(0, 1)
    assert played.stay(WALL, 1, 0.5) == [0.0]
    assert played.to(WALL, -0.003)[-1] == pytest.approx(1.0)
    # A gain of nothing is left as well.
    played.stay(WALL, 1, 0.0)
    played.stay(WALL, 1)
    assert played.to(WALL, -0.004)[-1] == pytest.approx(2.0)
    # What was quiet before it was moved does not count.
    played.to(WALL, 0.0)
    played.stay(WALL, 2 * TAPS, 0.5)
    assert played.enter(WALL, -1e-5, 1) == "OK"
    played.stay(WALL, 1, 0.5)
    played.stay(WALL, TAPS - 2)
    assert played.to(WALL, -0.00201)[-1] == pytest.approx(2.0)


def test_what_is_damping_only_has_its_gain_at_once(player: Player) -> None:
    played = Played(player)
    played.enter(WATER)
    played.to(0, 0.01)
    assert played.at(WATER, 0.0101).force == pytest.approx(-1.0, abs=1e-3)
    assert played.at(WATER, 0.0102, 0.25).force == pytest.approx(-0.25, abs=1e-3)
    assert played.at(WATER, 0.0103).force == pytest.approx(-1.0, abs=1e-3)
    assert played.at(0, 0.0104).force == 0


def test_a_spring_with_a_damper_that_stands_where_it_rests_comes_to_be_quiet(
    player: Player,
) -> None:
    """A filter alone would keep a speed of 1e-323 m/s for ever."""
    played, index = Played(player, 0.01), RUBBER.bit_length() - 1
    played.enter(RUBBER)
    played.stay(RUBBER, 1)
    played.to(RUBBER, 0.012)
    played.to(RUBBER, 0.01, 0.5)
    assert played.stay(RUBBER, 500)[-1] == 0.0
    assert player.level(index) == 1.0
    assert played.enter(RUBBER) == "OK"


@pytest.mark.parametrize("element", [WALL, RUBBER, GUM])
def test_a_spring_that_pushes_is_not_moved(player: Player, element: int) -> None:
    played = Played(player)
    played.enter(element, 0.0, 1)
    played.stay(element, 200)
    played.to(element, -0.002)
    (still,) = played.stay(element, 100)[-1:]
    assert still > 0.5
    assert played.enter(element | WATER, 0.001, 1) == "PUSHING"
    assert played.stay(element, 1) == pytest.approx([still])
    assert played.at(WATER, -0.002).status == "NOT_ENTERED"
    assert played.enter(element, 0.001, 1) == "OK"


def test_fades_stand_still_while_a_wall_pushes(player: Player) -> None:
    played = Played(player)
    cup = CUP.bit_length() - 1
    played.enter(CUP | GUM)
    played.enter(WALL, 0.0, 1)
    played.stay(WALL | CUP, 30)
    assert player.level(cup) == pytest.approx(0.3)
    played.to(WALL | CUP, -0.001)
    assert player.level(cup) == pytest.approx(0.3)
    played.stay(WALL, 100)
    assert player.level(cup) == pytest.approx(0.3)
    played.to(WALL, 0.0)  # no force in the last sample
    assert player.level(cup) == pytest.approx(0.29)
    played.stay(WALL, 30)
    assert player.level(cup) == 0.0


def test_a_gain_is_faded_to_where_an_element_fades(player: Player) -> None:
    played = Played(player)
    for element, index in ((CUP, 5), (GUM, 6)):
        played.enter(element)
        for samples, gain, level in ((200, 1.0, 1.0), (20, 0.5, 0.8), (100, 0.5, 0.5)):
            played.stay(element, samples, gain)
            assert player.level(index) == pytest.approx(level)
        played.stay(0, 100)
        assert player.level(index) == 0.0


def test_a_spring_that_fades_out_and_is_wanted_again_keeps_its_rest(player: Player) -> None:
    played = Played(player)
    played.enter(GUM)
    played.stay(GUM, 200)
    played.to(GUM, 0.002)
    assert played.stay(GUM, 300)[-1] == pytest.approx(-0.6)
    assert played.stay(0, 50)[-1] == pytest.approx(-0.3)
    assert played.stay(GUM, 100)[-1] == pytest.approx(-0.6)
    played.stay(0, 100)
    assert played.stay(GUM, 100) == pytest.approx([0.0] * 100, abs=1e-9)


def test_a_wall_never_waits_and_what_waits_is_entered_afterwards(player: Player) -> None:
    """Rubber is not certified with the cup that fades out; a wall is with either."""
    played = Played(player)
    played.enter(CUP | RUBBER)
    played.enter(WALL, 0.0, 1)
    played.stay(CUP | WALL, 200)
    replies = [played.at(WALL | RUBBER, -1e-4 * k) for k in range(1, 21)]
    assert {reply.status for reply in replies} == {"WAITING"}
    assert played.stay(WALL | RUBBER, 300)[-1] == pytest.approx(2000 * 2e-3)
    assert played.at(WALL | RUBBER | CUP, -0.002).status == "NOT_TOGETHER"
    assert played.at(WALL | RUBBER, -0.002).status == "OK"

    played = Played(player)
    played.enter(CUP | RUBBER)
    played.stay(CUP, 200)
    replies = [played.at(RUBBER, 1e-5 * k) for k in range(1, 151)]
    assert [reply.status for reply in replies].count("WAITING") == 100
    assert [reply.status for reply in replies[100:]] == ["OK"] * 50
    # It is entered in motion, and rests there.
    assert replies[100].force == pytest.approx(-10 * 0.01, abs=1e-3)
    assert played.stay(RUBBER, 100)[-1] == pytest.approx(-700 * 4.9e-4, abs=1e-3)


def test_a_pair_that_is_apart_is_refused_at_once(player: Player) -> None:
    """What still fades out counts; nothing of it is left afterwards, and the wall is not late."""
    played = Played(player)
    played.enter(CUP)
    played.enter(OTHER, 0.0, 1)
    assert played.at(OTHER | CUP, 0.0).status == "NOT_TOGETHER"
    assert played.at(OTHER, 0.0).status == "OK"
    played.stay(0, 2)
    played.stay(CUP, 200)
    reply = played.at(OTHER, 1e-5)
    assert (reply.status, reply.force) == ("NOT_TOGETHER", 0.0)
    assert player.level([*SIZES].index("cup")) == 0.0
    assert played.at(OTHER, -1e-5).status == "OK"
    assert played.to(OTHER, -1e-3)[-1] == pytest.approx(2.0, rel=0.05)


def test_walls_of_opposite_sides_meet_and_of_one_side_do_not(player: Player) -> None:
    played = Played(player)
    played.enter(WATER | CUP)
    played.enter(WALL | OTHER, -0.01, 1)
    assert played.at(WALL | OTHER, 0.0).status == "NOT_TOGETHER"
    assert played.enter(OTHER, 0.01, -1) == "OK"
    for others, status in ((0, "OK"), (WATER, "OK"), (CUP | WATER, "NOT_TOGETHER")):
        assert played.at(WALL | OTHER | others, 0.0).status == status
    played.stay(0, 1)
    played.to(WALL | OTHER, -0.011)
    assert played.stay(WALL | OTHER, 1) == pytest.approx([2.0])
    played.to(WALL | OTHER, 0.011)
    assert played.stay(WALL | OTHER, 1) == pytest.approx([-2.0])


@pytest.mark.parametrize(
    ("other", "room", "fits"),
    [
        (OTHER, 0.0, True),
        (OTHER, -1e-6, False),
        (SOFT, 0.00401, True),  # 0.2 m/s·(20/1000 + 0) s
        (SOFT, 0.00399, False),
        (SOFT, 0.0, False),
    ],
)
def test_a_corridor_has_room_for_both_dampers(
    player: Player, other: int, room: float, fits: bool
) -> None:
    """Walls that are alike are one clamp, which needs none; none overlap."""
    for first, second in ((WALL, other), (other, WALL)):
        for side in (1, -1):
            played = Played(player)
            played.enter(first, 0.0, side)
            played.enter(second, side * room, -side)
            inside = side * room / 2
            played.to(0, inside)
            played.stay(0, 100)
            status = "OK" if fits else "TOO_NARROW"
            assert played.at(first | second, inside).status == status
            assert played.at(first, inside).status == "OK"
            # It is known at once where the other wall is being played.
            assert played.enter(second, side * room, -side) == status
            assert played.enter(second, side * (room + 0.01), -side) == "OK"
            assert played.at(first | second, inside).status == "OK"


def test_walls_that_are_moved_at_once_do_not_crowd_each_other(player: Player) -> None:
    played = Played(player)
    played.enter(WALL, -0.01, 1)
    played.enter(OTHER, 0.01, -1)
    played.stay(WALL | OTHER, 1)
    assert played.enter(WALL, 0.02, 1) == "TOO_NARROW"
    assert played.enter(WALL | OTHER, 0.02, 1) == "OK"


@pytest.mark.parametrize("side", [1, -1])
def test_a_spring_that_is_no_finite_number_gives_none(player: Player, side: int) -> None:
    player.start()
    player.call(enter(WALL, 0.0, side))
    replies = [player.call(push(WALL, k, 1e308)) for k in range(5)]
    assert all(np.isfinite(reply.force) for reply in replies)
    assert all(reply.force == 0 or reply.status != "OK" for reply in replies[1:])


def test_the_sets_that_give_force_are_the_combinations(player: Player) -> None:
    """Each set of elements, walls of it on one side; and as if on two, where both halves are."""
    profile = scene()
    names = list(profile.elements)
    combinations = {frozenset(each) for each in profile.combinations()} | {frozenset[str]()}
    walls = names[:3]
    for sides in product((1, -1), repeat=3):
        for mask in range(1 << len(names)):
            chosen = frozenset(name for k, name in enumerate(names) if mask >> k & 1)
            played = Played(player)
            played.enter(RUBBER | WATER | CUP | GUM)
            for k, side in enumerate(sides):
                played.enter(1 << k, -0.1 * side, side)
            facing = dict(zip(walls, sides, strict=True))
            certified = all(
                frozenset(n for n in chosen if facing.get(n) != side) in combinations
                for side in (1, -1)
            )
            status = played.at(mask, 0.0).status
            assert status == ("OK" if certified else "NOT_TOGETHER"), chosen
