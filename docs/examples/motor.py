"""A direct-current motor that has to turn at a speed which is drawn anew for each episode."""

RESISTANCE, INDUCTANCE = 1.0, 0.02  # ohm, H
MOTOR_CONSTANT = 0.05  # V s/rad, and N m/A
INERTIA, FRICTION = 0.001, 0.0001  # kg m^2, N m s/rad


class Motor:
    """Its state holds the speed that is wanted, which no force changes."""

    features = {"error": "rad/s", "speed": "rad/s", "current": "A"}
    actions = {"voltage": (-12.0, 12.0)}  # V
    start = [(0.0, 100.0), 0.0, (20.0, 150.0)]  # speed, current, wanted speed
    max_episode_steps = 200
    dt = 0.01  # s
    integrator = "rk4"  # the default; the other is "euler"

    def derivative(state, voltage):
        speed, current, _ = state
        acceleration = (MOTOR_CONSTANT * current - FRICTION * speed) / INERTIA
        current_dot = (voltage - RESISTANCE * current - MOTOR_CONSTANT * speed) / INDUCTANCE
        return acceleration, current_dot, 0.0

    def observe(state):
        speed, current, wanted = state
        return wanted - speed, speed, current

    def reward(state, voltage):
        speed, _, wanted = state
        return 1.0 - abs(wanted - speed) / 50.0 - 0.001 * (voltage / 12.0) ** 2
