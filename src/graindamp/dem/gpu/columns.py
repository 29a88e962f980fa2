"""Names of the columns of the device's tables."""

# Slots.counts
STEP = 0
"""Steps done, settling included [-]."""
STAGE = 1
STATUS = 2
"""Status bits."""
ROW = 3
"""Rows written [-]."""
SIDE = 4
"""Which of the two copies of the outer lists is in use, 0 or 1."""
N_PAIR = 5
N_INNER = 6
N_TOUCH = 7
REFRESHES = 8
"""Renewals of the outer lists [-]."""
NARROWINGS = 9
"""Renewals of the inner list [-]."""
WANTED_PAIRS = 10
"""Room that full lists asked for [-]."""
WANTED_TOUCHES = 11
DUE = 12
"""Last step at which a list was due, for the blocks of a team."""
MEETINGS = 13
"""Arrivals of blocks of the team at its meetings [-]."""
NEXT_LOOK = 14
"""Whole cycles at which the stopping rule looks next [-]."""
ENOUGH = 15
"""1: known well enough, the world has ended."""
N_COUNT = 16

# Slots.codes
N_PARTICLE = 0
NORMAL = 1
TANGENTIAL = 2
TENSION = 3
ROLLING_CODE = 4
N_SETTLE = 5
"""Steps at rest before the motion."""
PER_ROW = 6
"""Steps between two rows, a cycle for motions with cycles."""
UNTIL = 7
"""Until when the world runs: UNTIL_END, UNTIL_KNOWN or UNTIL_CYCLE."""
END = 8
"""Last step."""
GIVEN = 9
"""1: velocities at the start of the motion are given; 0: those of the settled bed."""
N_CODE = 10

# Slots.numbers
GRAVITY = 0
"""0-2 [m/s^2]."""
TIME_STEP = 3
SKIN = 4
LARGEST = 5
"""Largest radius [m]."""
REACH = 6
"""Reach of the inner list [m]."""
CARRIED = 7
"""Velocity that the bounds on motion are relative to (7-9) [m/s]."""
CARRIED_SPEED = 10
"""Its size [m/s]."""
MOVING = 11
"""Between launches: acceleration (11-13) and velocity (14-16) of the container now, weights of the Fourier sums (17,
18); see :func:`graindamp.dem.gpu.steps.container`."""
WHOLE_MASS = 19
"""Mass of all particles [kg]."""
TOLERANCE = 20
"""Of the stopping rule, as in :class:`graindamp.signals.stopping.Stopping` [-]."""
FLOOR = 21
N_NUMBER = 22

# Slots.sums, one number per thread; the first N_TOTAL of a row of Slots.rows are their totals
FORCE_COS = 0
"""0-3: sums over the cycle as in :mod:`graindamp.dem.columns`."""
FORCE_SIN = 1
SPEED_COS = 2
SPEED_SIN = 3
LEDGER = 4
"""4-10: energies since the start of the motion [J], the ledger's columns."""
PAIR_CONTACTS = 11
"""Summed over the steps since the start of the motion [-]."""
WALL_CONTACTS = 12
KINETIC = 13
"""[J]"""
ROTATIONAL = 14
POTENTIAL = 15
ELASTIC = 16
MOMENT = 17
"""17-19: mass times position [kg m]."""
BED_MASS = 20
"""[kg]"""
N_TOTAL = 21
WIDEST_PAIR = 21
"""Largest overlap [m]."""
WIDEST_TOUCH = 22
WAY_INNER = 23
"""Way since the last renewal of the inner list [m]."""
WAY_OUTER = 24
"""Way since the last renewal of the outer lists [m]."""
WAY_WALL = 25
"""Likewise, with that of the carried velocity, relative to the walls [m]."""
WAY_LAST = 26
"""Way in the last step [m]."""
N_SUM = 27

# Slots.rows, after the totals
ROW_STEPS = 21
"""Steps since the row before [-]."""
ROW_TIME = 22
"""Since the start of the motion [s]."""
N_ROW = 23

# Slots.series
ETA = 0
"""Loss factor of every whole cycle [-]."""
RATIO = 1
"""Effective mass ratio of every whole cycle [-]."""
REST = 2
"""Room for what a straight line leaves over."""
PAIRS = 3
"""Room for means."""
N_SERIES = 4

# Record of a contact
FORCE = 0
"""Force on the first body (0-2) [N]."""
TORQUE = 3
"""Pairs: normal x tangential force (3-5) [N]; walls: torque (3-5) [N m]."""
ARMS = 6
"""Pairs: arms of the first and second body (6, 7) [m]."""
OVERLAP = 6
"""Walls: overlap [m]."""
ELEMENT = 7
"""Walls: number of the element."""
N_RECORD = 8

NEW, RUNNING, HALTED, IDLE = 0, 1, 2, 3
"""Stages of a slot: a world not started, between two steps, in a step whose lists had no room, no world."""

UNTIL_END, UNTIL_KNOWN, UNTIL_CYCLE = 0, 1, 2
"""A world runs to its last step, until it is known well enough, or until its next whole cycle."""

BEYOND = 1e9
"""A way that no list outlasts [m]."""
