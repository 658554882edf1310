/*
{% for line in head %}
 *{{ " " ~ line if line }}
{% endfor %}
 *
 * Units: q in rad (m for a slide), qd in rad/s (m/s), currents in A of each joint's own motor. Joints base to tip.
 * Nothing is allocated, no data changes, every function may be called from any thread.
 */
#ifndef {{ NAME }}_H
#define {{ NAME }}_H

#ifdef __cplusplus
extern "C" {
#endif

#define {{ NAME }}_JOINTS {{ n }}

/* The current that holds the arm at posture q: gravity, and whatever else pushes regardless of the direction. */
void {{ name }}_gravity(const double q[{{ NAME }}_JOINTS], double current[{{ NAME }}_JOINTS]);

/*
 * The current that overcomes friction at posture q and velocities qd.
 *
 * toward says which way each joint shall go, from -1 (backward) over 0 to 1 (forward); the friction of the two
 * directions is mixed in that proportion, each at the speed that qd has in its direction (0 where it has none).
 * With toward NULL it is the sign of qd, which gives the identified model exactly.
 *   At rest (qd 0, toward NULL or 0) it is the mean of both directions: nothing where friction is symmetric, else what
 *   the joint asks either way (an offset, or a vertical slide's load). It is the middle of the stiction band.
 *   Set-point control: where |qd| is below the noise of the velocity, take toward from the position error, such as
 *   error / 0.002 (values beyond -1 and 1 count as these); else the sign of qd. Then stiction is compensated at rest.
 *   Smoothing: toward = qd / width gives a friction without a jump, width being a few times the velocity's noise.
 * A velocity that is not a number gives a current that is not a number.
 */
void {{ name }}_friction(const double q[{{ NAME }}_JOINTS], const double qd[{{ NAME }}_JOINTS],
    const double toward[{{ NAME }}_JOINTS], double current[{{ NAME }}_JOINTS]);

/* Both of them added. */
void {{ name }}_current(const double q[{{ NAME }}_JOINTS], const double qd[{{ NAME }}_JOINTS],
    const double toward[{{ NAME }}_JOINTS], double current[{{ NAME }}_JOINTS]);
{% if dynamic %}

/* The current of inertia, centrifugal and Coriolis forces, rotors included; accelerations qdd in rad/s2 (m/s2). */
void {{ name }}_inertia(const double q[{{ NAME }}_JOINTS], const double qd[{{ NAME }}_JOINTS],
    const double qdd[{{ NAME }}_JOINTS], double current[{{ NAME }}_JOINTS]);

/* All three added: inverse dynamics. */
void {{ name }}_dynamics(const double q[{{ NAME }}_JOINTS], const double qd[{{ NAME }}_JOINTS],
    const double qdd[{{ NAME }}_JOINTS], const double toward[{{ NAME }}_JOINTS], double current[{{ NAME }}_JOINTS]);
{% endif %}

#ifdef __cplusplus
}
#endif

#endif
