/* The main loop of the motor's firmware. */

void controller(const float observation[3], float action[1]); /* as exported */

/* These five functions are your board's. */
void wait_for_tick(void);      /* returns every 10 ms, by a timer */
float read_wanted_speed(void); /* rad/s */
float read_speed(void);        /* rad/s */
float read_current(void);      /* A */
void set_voltage(float volts); /* -12 to 12 V */

/* A sensor that is broken may say anything, or NaN, for which both comparisons are false. */
static int within(float value, float limit)
{
    return value > -limit && value < limit;
}

int main(void)
{
    for (;;) {
        float observation[3];
        float action[1];
        wait_for_tick();
        const float wanted = read_wanted_speed();
        const float speed = read_speed();
        const float current = read_current();
        if (!within(wanted, 200.0f) || !within(speed, 300.0f) || !within(current, 30.0f)) {
            set_voltage(0.0f);
            continue;
        }
        observation[0] = wanted - speed; /* error */
        observation[1] = speed;
        observation[2] = current;
        controller(observation, action);
        set_voltage(action[0]);
    }
}
