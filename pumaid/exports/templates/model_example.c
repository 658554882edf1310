/*
 * A control loop that holds the arm up by {{ name }}.c, to copy and to fill in where it says YOURS: exports write this
 * file anew. {{ title }}
 *
 *   cc -std=c99 -O2 {{ name }}_example.c {{ name }}.c -o {{ name }}_example -lm
 *
 * {{ name }}_step is real-time safe: it allocates nothing, waits for nothing, reads and writes no file, and takes the
 * same time in every cycle. It keeps currents within limits, changes them no faster than allowed, and lets none pass
 * that is not a number. It does not replace the drives' own limits, brakes and emergency stop.
 */
#include "{{ name }}.h"

#include <stdio.h>

#define N {{ NAME }}_JOINTS

/* YOURS: s between two cycles. */
static const double PERIOD = 0.001;
/* YOURS: the largest current of each joint, A. Here what the model asks at most in random states within the
   limits of the recipe, with its friction. */
static const double LIMIT[N] = {{ largest }};
/* YOURS: s in which a current may go from nothing to its limit. */
static const double RISE = 0.2;
/* YOURS: share of the friction that is compensated too, 0 to 0.8 (more makes limit cycles), and the velocity (rad/s,
   m/s) below which it fades out, a few times the noise of qd. */
static const double SHARE = 0.0, FADE = 0.05;

/* What one cycle keeps for the next; begin with the currents that flow, so that nothing jumps. */
typedef struct {
    double current[N];
} {{ name }}_loop;

/* False of infinity and of what is not a number. */
static int is_number(double x)
{
    return x > -1e30 && x < 1e30;
}

/*
 * One cycle: currents (A, in loop->current) for positions q and velocities qd. Returns 1, or 0 where a reading or a
 * current is no number: all currents then stay as they were. Stop the arm if that lasts.
 */
int {{ name }}_step({{ name }}_loop *loop, const double q[N], const double qd[N])
{
    double toward[N], hold[N], rub[N], wanted[N];
    for (int i = 0; i < N; i++) {
        if (!is_number(q[i]) || !is_number(qd[i]))
            return 0;
        toward[i] = qd[i] / FADE;
    }
    {{ name }}_gravity(q, hold);
    {{ name }}_friction(q, qd, toward, rub);
    for (int i = 0; i < N; i++) {
        wanted[i] = hold[i] + SHARE * rub[i];
        if (!is_number(wanted[i]))
            return 0;
    }
    for (int i = 0; i < N; i++) {
        const double most = LIMIT[i], step = most * PERIOD / RISE, now = loop->current[i];
        double next = wanted[i] > most ? most : wanted[i] < -most ? -most : wanted[i];
        next = next > now + step ? now + step : next < now - step ? now - step : next;
        loop->current[i] = next;
    }
    return 1;
}

int main(void)
{
    {{ name }}_loop loop = { { 0.0 } }; /* YOURS: the currents that flow */
    double q[N] = {0.0}, qd[N] = {0.0};
    for (int cycle = 0; cycle < 1000; cycle++) { /* YOURS: until it shall stop, at a fixed rate */
        /* YOURS: read q (rad, m) and qd (rad/s, m/s) from the drives, joints base to tip. */
        if (!{{ name }}_step(&loop, q, qd))
            return 1; /* YOURS: brakes */
        /* YOURS: write loop.current (A) to the drives. */
    }
    for (int i = 0; i < N; i++)
        printf("joint %d: %.4f A\n", i + 1, loop.current[i]);
    return 0;
}
