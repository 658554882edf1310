/* {{ title }} See {{ name }}.h. */
#include "{{ name }}.h"

#include <math.h>
#include <stddef.h>

#define N {{ NAME }}_JOINTS
#define SIGN(x) (((x) > 0.0) - ((x) < 0.0))

/* Which joints turn; rotation of each joint's frame at zero in that of the joint before, row by row; offset of d. */
static const int TURNS[N] = {{ turns }};
static const double PLACED[N][9] = {{ placed }};
static const double D[N] = {{ d }};
/* Free fall in axes of the base, m/s2. */
static const double GRAVITY[3] = {{ g }};
/* First moments k_x, k_y of each link in A s2/m (of a slide: mass, and nothing), in the gain of its own joint. */
static const double MOMENT[N][2] = {{ moments }};
/* Gains: link j counts RATIO[i][j] times in joint i. */
static const double RATIO[N][N] = {{ ratios }};
{% if uses_tilt or uses_across %}
/* The same for moments across an axis, which an upright joint counts in the gain of the next one. */
static const double FELT[N][N] = {{ felt }};
{% endif %}
/* Friction forward and backward: A, and A s/rad (A s/m). */
static const double COULOMB[N][2] = {{ coulomb }};
static const double VISCOUS[N][2] = {{ viscous }};
{% if dynamic %}
/* Offset of each joint's frame in that of the joint before, m; and of each link, in the gain of its own joint, mass,
   first moments, inertia (xx, xy, xz, yy, yz, zz) about its frame's origin, and the rotor's: in A for N m (N). */
static const double OFFSET[N][3] = {{ offset }};
static const double BODY[N][11] = {{ bodies }};
{% endif %}
{% if geared %}
/* From the joints' velocities to those that drive their friction. */
static const double SHAFT[N][N] = {{ shaft }};
{% endif %}
{% if curved %}
/* Learned curves: lowest and highest value of the variable, then coefficients of cubic B-splines on equal segments. */
static const double CURVES[][{{ segments + 5 }}] = {{ curves }};

static double curve(double row, double x)
{
    const double *a = CURVES[(int)row], share = (x - a[0]) / (a[1] - a[0]);
    const double u = {{ segments }}.0 * (share > 0.0 ? (share < 1.0 ? share : 1.0) : 0.0);
    const int i = u < {{ segments - 1 }}.0 ? (int)u : {{ segments - 1 }};
    const double t = u - i, s = 1.0 - t;
    a += i + 2;
    return (s * s * s * a[0] + ((3.0 * t - 6.0) * t * t + 4.0) * a[1] + ((3.0 * s - 6.0) * s * s + 4.0) * a[2]
            + t * t * t * a[3]) / 6.0;
}
{% endif %}

/* Axes, first moment of each link in base axes, and gravity's current at a posture. */
typedef struct {
    double z[N][3], moment[N][3], load[N];
} posture;

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Moment of the links from `from` to the tip, each counted by its gain. */
static void gathered(const posture *at, const double gains[N], int from, double out[3])
{
    out[0] = out[1] = out[2] = 0.0;
    for (int j = from; j < N; j++)
        for (int k = 0; k < 3; k++)
            out[k] += gains[j] * at->moment[j][k];
}

static void look(const double q[N], posture *at)
{
    double x[3] = {1.0, 0.0, 0.0}, y[3] = {0.0, 1.0, 0.0}, z[3] = {0.0, 0.0, 1.0};
    for (int i = 0; i < N; i++) {
        const double turn = TURNS[i] ? q[i] : 0.0, slide = D[i] + (TURNS[i] ? 0.0 : q[i]);
        const double c = cos(turn), s = sin(turn), *p = PLACED[i];
        for (int k = 0; k < 3; k++) {
            const double first = p[0] * x[k] + p[3] * y[k] + p[6] * z[k];
            const double second = p[1] * x[k] + p[4] * y[k] + p[7] * z[k];
            z[k] = p[2] * x[k] + p[5] * y[k] + p[8] * z[k];
            x[k] = c * first + s * second;
            y[k] = c * second - s * first;
            at->z[i][k] = z[k];
            at->moment[i][k] = TURNS[i] ? MOMENT[i][0] * x[k] + MOMENT[i][1] * y[k] : MOMENT[i][0] * slide * z[k];
        }
    }
    for (int i = 0; i < N; i++) {
        double lever[3], sum[3];
        cross(at->z[i], GRAVITY, lever);
        gathered(at, RATIO[i], i, sum);
        at->load[i] = TURNS[i] ? dot(lever, sum) : -dot(at->z[i], GRAVITY) * MOMENT[i][0];
    }
}
{% if uses_slope %}

/* Derivative of joint i's gravity current by joint m's position, A/rad or A/m. */
static double slope(const posture *at, int i, int m)
{
    double lever[3], turned[3], sum[3];
    cross(at->z[i], GRAVITY, lever);
    if (!TURNS[m])
        return TURNS[i] && m > i ? dot(lever, at->z[m]) * MOMENT[m][0] * RATIO[i][m] : 0.0;
    if (!TURNS[i]) {
        cross(at->z[m], at->z[i], turned);
        return m < i ? -dot(turned, GRAVITY) * MOMENT[i][0] : 0.0;
    }
    if (m > i) {
        gathered(at, RATIO[i], m, sum);
        cross(at->z[m], sum, turned);
        return dot(lever, turned);
    }
    gathered(at, RATIO[i], i, sum);
    cross(at->z[m], GRAVITY, turned);
    cross(at->z[i], turned, lever);
    return -dot(lever, sum);
}
{% endif %}
{% if uses_tilt %}

/* Derivative of joint i's gravity current by a turn of the base about its axis `axis`, A/rad. */
static double tilt(const posture *at, int i, int axis)
{
    double e[3] = {0.0, 0.0, 0.0}, way[3], lever[3], sum[3];
    e[axis] = 1.0;
    cross(GRAVITY, e, way);
    if (!TURNS[i])
        return -dot(at->z[i], way) * MOMENT[i][0];
    gathered(at, FELT[i], i, sum);
    cross(at->z[i], way, lever);
    return dot(lever, sum);
}
{% endif %}
{% if uses_across %}

/* Gravity's moment across joint i's axis, as the current that it would draw if it lay along it. */
static double across(const posture *at, int i)
{
    double sum[3], moment[3];
    if (!TURNS[i])
        return 0.0;
    gathered(at, FELT[i], i, sum);
    cross(GRAVITY, sum, moment);
    const double along = dot(at->z[i], moment);
    for (int k = 0; k < 3; k++)
        moment[k] -= at->z[i][k] * along;
    return sqrt(dot(moment, moment));
}
{% endif %}

static void hold(const double q[N], const posture *at, double current[N])
{
    (void)q;
    for (int i = 0; i < N; i++)
        current[i] = at->load[i];
{% for term in holds %}
    current[{{ term.joint - 1 }}] += {{ term.text }}; /* {{ term.effect }} */
{% endfor %}
}

/* The velocity that drives the friction of joint i. */
static double shaft(const double qd[N], int i)
{
{% if geared %}
    double v = 0.0;
    for (int k = 0; k < N; k++)
        v += SHAFT[i][k] * qd[k];
    return v;
{% else %}
    return qd[i];
{% endif %}
}

/* Friction of joint i while it moves forward (s = 1, v >= 0) or backward (s = -1, v <= 0). */
static double moving(int i, double s, double v, const double q[N], const double qd[N], const posture *at)
{
    const int way = s > 0.0 ? 0 : 1;
    const double base = COULOMB[i][way] + VISCOUS[i][way] * v;
    double sum = base;
    (void)q;
    (void)qd;
    (void)at;
{% if frictions %}
    switch (i) {
{% for joint, terms in frictions %}
    case {{ joint - 1 }}:
{% for term in terms %}
        sum += {{ term.text }}; /* {{ term.effect }} */
{% endfor %}
        break;
{% endfor %}
    default:
        break;
    }
{% endif %}
    return sum;
}

static void resist(const double q[N], const double qd[N], const double toward[N], const posture *at, double current[N])
{
    for (int i = 0; i < N; i++) {
        const double v = shaft(qd, i);
        double way = toward ? toward[i] : SIGN(v);
        if (way > 1.0)
            way = 1.0;
        if (way < -1.0)
            way = -1.0;
        current[i] = v - v + way - way; /* 0, or not a number where the input is not */
        if (way > -1.0)
            current[i] += 0.5 * (1.0 + way) * moving(i, 1.0, v > 0.0 ? v : 0.0, q, qd, at);
        if (way < 1.0)
            current[i] += 0.5 * (1.0 - way) * moving(i, -1.0, v < 0.0 ? v : 0.0, q, qd, at);
    }
}

{% if dynamic %}
/* Adds the acceleration of a point at `way` from the origin of a body with this angular velocity and acceleration. */
static void swing(const double spin[3], const double rate[3], const double way[3], double out[3])
{
    double a[3], b[3], c[3];
    cross(rate, way, a);
    cross(spin, way, b);
    cross(spin, b, c);
    for (int k = 0; k < 3; k++)
        out[k] += a[k] + c[k];
}

/* Inertia of a body, its axes being the columns of `frame`, times v. */
static void inertia_times(const double body[11], double frame[3][3], const double v[3], double out[3])
{
    const double *b = body + 4;
    double l[3];
    for (int k = 0; k < 3; k++)
        l[k] = frame[0][k] * v[0] + frame[1][k] * v[1] + frame[2][k] * v[2];
    const double m[3] = {b[0] * l[0] + b[1] * l[1] + b[2] * l[2], b[1] * l[0] + b[3] * l[1] + b[4] * l[2],
        b[2] * l[0] + b[4] * l[1] + b[5] * l[2]};
    for (int k = 0; k < 3; k++)
        out[k] = frame[k][0] * m[0] + frame[k][1] * m[1] + frame[k][2] * m[2];
}

/* Newton and Euler, base to tip: each link's force and moment, and what they ask of every joint before it. */
static void accelerate(const double q[N], const double qd[N], const double qdd[N], double current[N])
{
    double axis[N][3], origin[N][3], frame[3][3] = {{ "{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}" }};
    double at[3] = {0.0, 0.0, 0.0}, spin[3] = {0.0, 0.0, 0.0}, rate[3] = {0.0, 0.0, 0.0}, pull[3] = {0.0, 0.0, 0.0};
    for (int j = 0; j < N; j++) {
        const double turn = TURNS[j] ? q[j] : 0.0, slide = TURNS[j] ? 0.0 : q[j];
        const double c = cos(turn), s = sin(turn), *p = PLACED[j], *body = BODY[j];
        double way[3], z[3], turned[3], moment[3], force[3], couple[3], lever[3], part[3];
        for (int k = 0; k < 3; k++) {
            const double x = frame[k][0], y = frame[k][1], last = frame[k][2];
            const double first = p[0] * x + p[3] * y + p[6] * last, second = p[1] * x + p[4] * y + p[7] * last;
            z[k] = p[2] * x + p[5] * y + p[8] * last;
            way[k] = OFFSET[j][0] * x + OFFSET[j][1] * y + OFFSET[j][2] * last + slide * z[k];
            frame[k][0] = c * first + s * second;
            frame[k][1] = c * second - s * first;
            frame[k][2] = z[k];
        }
        swing(spin, rate, way, pull);
        cross(spin, z, turned);
        for (int k = 0; k < 3; k++) {
            at[k] += way[k];
            axis[j][k] = z[k];
            origin[j][k] = at[k];
            if (TURNS[j]) {
                rate[k] += turned[k] * qd[j] + z[k] * qdd[j];
                spin[k] += z[k] * qd[j];
            } else {
                pull[k] += 2.0 * turned[k] * qd[j] + z[k] * qdd[j];
            }
            moment[k] = frame[k][0] * body[1] + frame[k][1] * body[2] + frame[k][2] * body[3];
            force[k] = body[0] * pull[k];
        }
        swing(spin, rate, moment, force);
        inertia_times(body, frame, rate, couple);
        inertia_times(body, frame, spin, lever);
        cross(spin, lever, part);
        cross(moment, pull, turned);
        for (int k = 0; k < 3; k++)
            couple[k] += part[k] + turned[k];
        current[j] = body[10] * qdd[j];
        for (int i = 0; i <= j; i++) {
            for (int k = 0; k < 3; k++)
                lever[k] = at[k] - origin[i][k];
            cross(lever, force, part);
            for (int k = 0; k < 3; k++)
                part[k] += couple[k];
            current[i] += RATIO[i][j] * dot(axis[i], TURNS[i] ? part : force);
        }
    }
}

{% endif %}
void {{ name }}_gravity(const double q[N], double current[N])
{
    posture at;
    look(q, &at);
    hold(q, &at, current);
}

void {{ name }}_friction(const double q[N], const double qd[N], const double toward[N], double current[N])
{
    posture at;
    look(q, &at);
    resist(q, qd, toward, &at, current);
}

void {{ name }}_current(const double q[N], const double qd[N], const double toward[N], double current[N])
{
    posture at;
    double friction[N];
    look(q, &at);
    hold(q, &at, current);
    resist(q, qd, toward, &at, friction);
    for (int i = 0; i < N; i++)
        current[i] += friction[i];
}
{% if dynamic %}

void {{ name }}_inertia(const double q[N], const double qd[N], const double qdd[N], double current[N])
{
    accelerate(q, qd, qdd, current);
}

void {{ name }}_dynamics(
    const double q[N], const double qd[N], const double qdd[N], const double toward[N], double current[N])
{
    double inertia[N];
    {{ name }}_current(q, qd, toward, current);
    accelerate(q, qd, qdd, inertia);
    for (int i = 0; i < N; i++)
        current[i] += inertia[i];
}
{% endif %}
