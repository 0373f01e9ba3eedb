/* The board's functions on a PC: they simulate the motor of motor.py for two seconds, from standstill. */

#include <stdio.h>
#include <stdlib.h>

#define DT 0.01 /* s */

static double speed, current, voltage;
static int tick;

static void derivative(const double state[2], double slope[2])
{
    slope[0] = (0.05 * state[1] - 0.0001 * state[0]) / 0.001;
    slope[1] = (voltage - 1.0 * state[1] - 0.05 * state[0]) / 0.02;
}

/* One Runge-Kutta step of fourth order, as the plant is integrated in training. */
static void step(void)
{
    static const double ahead[4] = {0.0, DT / 2, DT / 2, DT}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    double slope[2] = {0.0, 0.0}, change[2] = {0.0, 0.0};
    for (int stage = 0; stage < 4; stage++) {
        const double state[2] = {speed + ahead[stage] * slope[0], current + ahead[stage] * slope[1]};
        derivative(state, slope);
        change[0] += weight[stage] * slope[0] * DT / 6;
        change[1] += weight[stage] * slope[1] * DT / 6;
    }
    speed += change[0];
    current += change[1];
}

void wait_for_tick(void)
{
    if (tick > 0) {
        step();
    }
    if (tick % 20 == 0) {
        printf("%4.1f s  %6.2f rad/s  %6.2f A  %6.2f V\n", tick * DT, speed, current, voltage);
    }
    if (tick++ == 200) {
        exit(0);
    }
}

float read_wanted_speed(void) { return 100.0f; }
float read_speed(void) { return (float)speed; }
float read_current(void) { return (float)current; }
void set_voltage(float volts) { voltage = volts; }
