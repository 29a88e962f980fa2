"""Names of the columns of the engine's number tables, one place for all that write or read them."""

# Interaction of two materials (Rules.pair).
STIFFNESS = 0
"""Hertz: (4/3) E* [Pa]; linear: stiffness [N/m], or by rule 1 stiffness over radius of the first member [N/m^2]."""
SHEAR = 1
"""Hertz: 8 G* [Pa]; linear: tangential over normal stiffness [-], or by rule 1 as STIFFNESS."""
FRICTION = 2
"""Coefficient of friction [-]."""
ROLLING = 3
"""Coefficient of rolling resistance [-]."""
TANGENTIAL_DASHPOT = 4
"""Tangential over normal dashpot [-]; for springs."""
SPEED_SCALE = 5
"""Speed at the middle of the loss table [m/s]."""
SMOOTHING = 6
"""Slope tau of tanh friction [s/m]."""
RULE = 7
"""0: stiffness as given; 1: two entities in series, each proportional to its radius (Wong & Rongong 2009)."""
N_COLUMN = 8

N_NODE = 513
"""Nodes of the loss table, even in v / (v + SPEED_SCALE)."""

# What a contact remembers (Contacts.grip): one cache line, first what the normal force needs.
GRIP_STIFFNESS = 0
"""Stiffness with the radii in it [N/m^1.5] or [N/m]."""
DAMPING = 1
"""Gonthier: d / (e onset) [s/m]; viscous laws: dashpot without its factor of overlap."""
LEAST = 2
"""Gonthier: 1 - d [-]."""
MASS = 3
"""Reduced mass [kg]."""
GRIP_FRICTION = 4
"""Coefficient of friction [-]."""
GRIP_TANGENTIAL = 5
"""Slope of tanh friction [s/m]; Mindlin: 8 G* sqrt(R*) [N/m^1.5]; linear: tangential stiffness [N/m]."""
ONSET = 6
"""Largest approach speed since the contact began [m/s]."""
TOUCHED = 7
"""Step at which the bodies last touched [-]."""
N_GRIP = 8

# Sums over a cycle (Record.fourier).
FORCE_COS = 0
"""Sum of force along the motion times cos(omega t) [N]."""
FORCE_SIN = 1
SPEED_COS = 2
"""Sum of the container's velocity along the motion times cos(omega t) [m/s]."""
SPEED_SIN = 3
N_STEP = 4
"""Steps in the sums [-]."""
N_FOURIER = 5

# Energies since the start (Record.ledger) [J].
WORK_CONTAINER = 0
"""Work of the container's walls on the particles, in the frame at rest."""
LOSS_NORMAL = 1
"""Dissipated by normal damping between particles."""
LOSS_FRICTION = 2
"""Dissipated by friction between particles."""
LOSS_NORMAL_WALL = 3
LOSS_FRICTION_WALL = 4
LOSS_LID = 5
"""Dissipated in foam."""
LOSS_ROLLING = 6
N_LEDGER = 7

N_SPEED_BIN = 128
LOWEST_SPEED = 1e-6
"""Lower end of the first bin of the impact speed histogram [m/s]; bins are a quarter of an octave wide."""

LANE = 16
"""Contacts in a block of the force computation [-]: enough that the compiler keeps the loops, few enough for the
fastest cache."""
N_BUFFER = 58 * LANE
"""Numbers in the buffer of a block."""
