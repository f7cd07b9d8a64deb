/* A hysteresis that has no closed form between the samples, on panels of polynomials.
 *
 * A step is one panel where the output is smooth in it. Where it is not, because the hysteretic
 * displacement passes zero, say, panels are halved until they are. On each panel the output is a
 * polynomial of ninth degree through its values at the points of Gauss and Legendre, and modes and
 * lags are exact for it: by their tables over a whole step, by power series over a part of one.
 */
#ifndef FS_PANELS_H
#define FS_PANELS_H

#include "instance.h"
#include "lags.h"
#include "model_data.h"
#include "model_hysteresis.h"
#include "modes.h"
#include "real.h"

#if FS_HAS_PANELS

#define FS_POINTS 10
/* A panel is good where the two highest of its Legendre coefficients, times its length, are this
 * part of the output; the deepest is past the rounding of its ends. A kink beyond the outermost
 * points shows only at the ends, whose error acts over a small part of the panel. */
#ifdef FS_SINGLE
#define FS_GOOD 2e-6f
#define FS_DEEPEST 16
#define FS_TINY 1e-37f
#else
#define FS_GOOD 4e-15
#define FS_DEEPEST 40
#define FS_TINY 1e-300
#endif
#define FS_END_SHARE FS_R(0.05)
/* A step halves no more panels than this, so that its time is bounded: what is rough then, stays
 * so. A kink in the output takes some 40 of them. */
#ifndef FS_HALVINGS_MAX
#define FS_HALVINGS_MAX 2000
#endif
/* The largest angle of a mode, or ratio of a lag, of one power series, and its terms. */
#define FS_PANEL_TURN FS_R(1.0)
#define FS_PANEL_TERMS 20

/* Points of a panel. */
static const fs_real fs_panel_share[FS_POINTS] = {
    0.013046735741414128, 0.06746831665550773, 0.16029521585048778, 0.2833023029353764, 0.4255628305091844,
    0.5744371694908156, 0.7166976970646236, 0.8397047841495122, 0.9325316833444923, 0.9869532642585859};

/* From values at the points to Legendre coefficients. */
static const fs_real fs_panel_legendre[FS_POINTS][FS_POINTS] = {
    {0.03333567215434407, 0.0747256745752902, 0.109543181257991, 0.13463335965499826,
     0.1477621123573764, 0.1477621123573764, 0.13463335965499826, 0.109543181257991,
     0.0747256745752902, 0.03333567215434407},
    {-0.09739748623087134, -0.19392733087861797, -0.22327405646578036, -0.17504843391186797,
     -0.0659939604112018, 0.0659939604112018, 0.17504843391186797, 0.22327405646578036,
     0.19392733087861797, 0.09739748623087134},
    {0.1538009388676572, 0.2325843879189393, 0.10537837264449207, -0.14692043662014193,
     -0.344843262810947, -0.344843262810947, -0.14692043662014193, 0.10537837264449207,
     0.2325843879189393, 0.1538009388676572},
    {-0.1979975222587465, -0.1678024749334323, 0.18026002472505723, 0.4208717251103699,
     0.2224466682916719, -0.2224466682916719, -0.4208717251103699, -0.18026002472505723,
     0.1678024749334323, 0.1979975222587465},
    {0.22623866153420158, 0.012620567594914449, -0.4178191706251152, -0.21206611172245454,
     0.3910260532184535, 0.3910260532184535, -0.21206611172245454, -0.4178191706251152,
     0.012620567594914449, 0.22623866153420158},
    {-0.23582650999695345, 0.18693298324845603, 0.3979021506397245, -0.3268972356387912,
     -0.40771747957258736, 0.40771747957258736, 0.3268972356387912, -0.3979021506397245,
     -0.18693298324845603, 0.23582650999695345},
    {0.2253004701711277, -0.3655606549307788, -0.08280299502148115, 0.5622289027158052,
     -0.3391657229346718, -0.3391657229346718, 0.5622289027158052, -0.08280299502148115,
     -0.3655606549307788, 0.2253004701711277},
    {-0.1945477649167062, 0.45914932601828756, -0.3445294063096419, -0.14005678673071348,
     0.5847523399312818, -0.5847523399312818, 0.14005678673071348, 0.3445294063096419,
     -0.45914932601828756, 0.1945477649167062},
    {0.14483086372474532, -0.42574993188706195, 0.592158457003241, -0.5143321814813059,
     0.20309279264038202, 0.20309279264038202, -0.5143321814813059, 0.592158457003241,
     -0.42574993188706195, 0.14483086372474532},
    {-0.0787294888197711, 0.2605555054613421, -0.46142366598172685, 0.628279653017819,
     -0.722217908648829, 0.722217908648829, -0.628279653017819, 0.46142366598172685,
     -0.2605555054613421, 0.0787294888197711}};

/* Legendre polynomials on a panel: row n holds the coefficients of 1, x, x^2 ... */
static const fs_real fs_panel_powers[FS_POINTS][FS_POINTS] = {
    {1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {1.0, -6.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-1.0, 12.0, -30.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {1.0, -20.0, 90.0, -140.0, 70.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-1.0, 30.0, -210.0, 560.0, -630.0, 252.0, 0.0, 0.0, 0.0, 0.0},
    {1.0, -42.0, 420.0, -1680.0, 3150.0, -2772.0, 924.0, 0.0, 0.0, 0.0},
    {-1.0, 56.0, -756.0, 4200.0, -11550.0, 16632.0, -12012.0, 3432.0, 0.0, 0.0},
    {1.0, -72.0, 1260.0, -9240.0, 34650.0, -72072.0, 84084.0, -51480.0, 12870.0, 0.0},
    {-1.0, 90.0, -1980.0, 18480.0, -90090.0, 252252.0, -420420.0, 411840.0, -218790.0, 48620.0}};

/* How far a panel is from a polynomial, and its Legendre coefficients. */
static inline fs_real fs_panel_rough(fs_real begin, const fs_real *values, fs_real *legendre)
{
    fs_real first = -begin, last = -values[FS_POINTS], tail, ends;
    int i, j;
    for (i = 0; i < FS_POINTS; i++) {
        fs_real sum = FS_R(0.0);
        for (j = 0; j < FS_POINTS; j++)
            sum += fs_panel_legendre[i][j] * values[j];
        legendre[i] = sum;
        first += i % 2 ? -sum : sum;
        last += sum;
    }
    tail = FS_ABS(legendre[FS_POINTS - 2]);
    if (FS_ABS(legendre[FS_POINTS - 1]) > tail)
        tail = FS_ABS(legendre[FS_POINTS - 1]);
    ends = FS_END_SHARE * (FS_ABS(first) > FS_ABS(last) ? FS_ABS(first) : FS_ABS(last));
    return ends > tail ? ends : tail;
}

/* Coefficients of 1, x, x^2 ... in the share x of a panel. */
static inline void fs_panel_monomials(const fs_real *legendre, fs_real *c)
{
    int k, n;
    for (k = 0; k < FS_POINTS; k++) {
        c[k] = FS_R(0.0);
        for (n = FS_POINTS - 1; n >= k; n--)
            c[k] += fs_panel_powers[n][k] * legendre[n];
    }
}

/* The same in the share of a part of the panel that begins at x and is as wide as width. */
static inline void fs_panel_part(const fs_real *c, fs_real x, fs_real width, fs_real *part)
{
    fs_real power = FS_R(1.0);
    int i, j;
    for (i = 0; i < FS_POINTS; i++)
        part[i] = c[i];
    for (i = 0; i < FS_POINTS - 1; i++)
        for (j = FS_POINTS - 2; j >= i; j--)
            part[j] += x * part[j + 1];
    for (i = 0; i < FS_POINTS; i++) {
        part[i] *= power;
        power *= width;
    }
}

/* Modes and lags of a drive through a panel that is a whole step. */
static inline void fs_panel_whole(const fs_modes *modes, fs_drive *drive, int lags, fs_real *v,
                                  const fs_real *c)
{
    fs_real derivative[FS_POINTS], factorial = FS_R(1.0);
    fs_real by_z[FS_MODES], by_v[FS_MODES], by[FS_LAGS_MAX];
    int j, m;
    for (j = 0; j < FS_POINTS; j++) {
        derivative[j] = factorial * c[j];
        factorial *= (fs_real)(j + 1);
    }
    for (m = 0; m < FS_MODES; m++)
        by_z[m] = by_v[m] = FS_R(0.0);
    for (j = FS_POINTS - 1; j >= 0; j--)
        for (m = 0; m < FS_MODES; m++) {
            by_z[m] += modes->moments[j + 1][m] * derivative[j];
            by_v[m] += modes->moments[j][m] * derivative[j];
        }
    for (m = 0; m < FS_MODES; m++) {
        const fs_real at = drive->z[m], speed = v[m];
        drive->z[m] =
            (modes->transition[0][m] * at + modes->transition[1][m] * speed) + by_z[m];
        v[m] = (modes->transition[2][m] * at + modes->transition[3][m] * speed) + by_v[m];
    }
    for (m = 0; m < lags; m++)
        by[m] = FS_R(0.0);
    for (j = FS_POINTS - 1; j >= 0; j--)
        for (m = 0; m < lags; m++)
            by[m] += drive->lags.moments[j][m] * derivative[j];
    for (m = 0; m < lags; m++)
        fs_lag_add(&drive->lags, m, &drive->lag[m], &drive->lag_rest[m], by[m]);
}

/* The same through a short part d of a step, with force c in the share of that part. */
static inline void fs_panel_short(const fs_modes *modes, fs_drive *drive, int lags, fs_real *v,
                                  fs_real d, const fs_real *c)
{
    fs_real low[FS_MODES], high[FS_MODES], speed[FS_MODES];
    fs_real term[FS_LAGS_MAX];
    int j, m;
    for (m = 0; m < FS_MODES; m++) {
        low[m] = drive->z[m];
        high[m] = speed[m] = v[m] * d;
        drive->z[m] += high[m];
    }
    for (j = 0; j < FS_PANEL_TERMS; j++) {
        const fs_real force = j < FS_POINTS ? c[j] : FS_R(0.0);
        const fs_real n = (fs_real)(j + 1);
        const fs_real over = FS_R(1.0) / (n * (n + FS_R(1.0)));
        for (m = 0; m < FS_MODES; m++) {
            const fs_real turn = modes->angle[m] * d;
            const fs_real following =
                turn * (turn * (force - low[m]) -
                        FS_R(2.0) * modes->damping_ratio[m] * n * high[m]) * over;
            drive->z[m] += following;
            speed[m] += (n + FS_R(1.0)) * following;
            low[m] = high[m];
            high[m] = following;
        }
    }
    for (m = 0; m < FS_MODES; m++)
        v[m] = speed[m] / d;
    for (m = 0; m < lags; m++)
        term[m] = drive->lag[m];
    for (j = 0; j < FS_PANEL_TERMS; j++) {
        const fs_real force = j < FS_POINTS ? c[j] : FS_R(0.0);
        for (m = 0; m < lags; m++) {
            term[m] = drive->lags.ratio[m] * d * (force - term[m]) / (fs_real)(j + 1);
            drive->lag[m] += term[m];
        }
    }
}

/* The largest angle of a mode in a step, or ratio of a lag. */
static inline fs_real fs_panel_turn(const fs_modes *modes, const fs_drive *drive, int lags)
{
    fs_real largest = FS_R(0.0);
    int m;
    for (m = 0; m < FS_MODES; m++) {
        const fs_real twice = FS_R(2.0) * modes->damping_ratio[m];
        const fs_real turn = modes->angle[m] * (twice > FS_R(1.0) ? twice : FS_R(1.0));
        largest = turn > largest ? turn : largest;
    }
    for (m = 0; m < lags; m++)
        largest = drive->lags.ratio[m] > largest ? drive->lags.ratio[m] : largest;
    return largest;
}

/* One step of a drive from its last voltage to u1: modes, lags, memory and free displacement. */
static inline const char *fs_panels_step(fs_stage *s, int d, fs_real u1, fs_real *v)
{
    static const char *const away = "the hysteresis is no longer finite: its parameters let it "
                                    "run away";
    fs_drive *drive = &s->drive[d];
    const int lags = fs_data_lags[d];
    const fs_real u0 = drive->memory[0], rise = u1 - u0;
    const fs_real turn = fs_panel_turn(&s->modes, drive, lags);
    fs_real now[FS_MEMORY_MAX], trial[FS_MEMORY_MAX];
    fs_real values[FS_POINTS + 1], legendre[FS_POINTS], c[FS_POINTS], part[FS_POINTS];
    fs_real begins[FS_DEEPEST + 2], y, scale, here = FS_R(0.0);
    int depths[FS_DEEPEST + 2], waiting = 0, halvings = 0, i;
    for (i = 0; i < FS_MEMORY_MAX; i++)
        now[i] = drive->memory[i];
    y = fs_hysteresis_move(d, drive->parameters, now, u0);
    for (i = 0; i < FS_MEMORY_MAX; i++)
        trial[i] = now[i];
    for (i = 0; i < FS_POINTS; i++)
        values[i] = fs_hysteresis_move(d, drive->parameters, trial, u0 + rise * fs_panel_share[i]);
    values[FS_POINTS] = fs_hysteresis_move(d, drive->parameters, trial, u1);
    if (!FS_FINITE(y) || !FS_FINITE(values[FS_POINTS]))
        return away;
    for (i = 0; i < FS_MEMORY_MAX; i++)
        drive->memory[i] = trial[i];
    drive->free = values[FS_POINTS];
    scale = FS_ABS(y) > FS_ABS(drive->free) ? FS_ABS(y) : FS_ABS(drive->free);
    scale = scale > FS_TINY ? scale : FS_TINY;
    if (fs_panel_rough(y, values, legendre) <= FS_GOOD * scale) {
        fs_panel_monomials(legendre, c);
        fs_panel_whole(&s->modes, drive, lags, v, c);
        return 0;
    }
    begins[waiting] = FS_R(0.5);
    depths[waiting++] = 1;
    begins[waiting] = FS_R(0.0);
    depths[waiting++] = 1;
    while (waiting > 0) {
        const int depth = depths[--waiting];
        const fs_real at = begins[waiting];
        fs_real length = FS_R(1.0), rough;
        for (i = 0; i < depth; i++)
            length *= FS_R(0.5);
        if (at > here) {
            y = fs_hysteresis_move(d, drive->parameters, now, u0 + rise * at);
            here = at;
        }
        for (i = 0; i < FS_MEMORY_MAX; i++)
            trial[i] = now[i];
        for (i = 0; i <= FS_POINTS; i++) {
            const fs_real share = i < FS_POINTS ? fs_panel_share[i] : FS_R(1.0);
            values[i] = fs_hysteresis_move(d, drive->parameters, trial,
                                           u0 + rise * (at + length * share));
            if (!FS_FINITE(values[i]))
                return away;
        }
        rough = fs_panel_rough(y, values, legendre);
        if (depth >= FS_DEEPEST || halvings >= FS_HALVINGS_MAX ||
            length * rough <= FS_GOOD * scale) {
            const int parts = 1 + (int)(turn * length / FS_PANEL_TURN);
            fs_panel_monomials(legendre, c);
            for (i = 0; i < parts; i++) {
                fs_panel_part(c, (fs_real)i / (fs_real)parts, FS_R(1.0) / (fs_real)parts, part);
                fs_panel_short(&s->modes, drive, lags, v, length / (fs_real)parts, part);
            }
        } else {
            halvings++;
            begins[waiting] = at + FS_R(0.5) * length;
            depths[waiting++] = depth + 1;
            begins[waiting] = at;
            depths[waiting++] = depth + 1;
        }
    }
    return 0;
}

#endif
#endif
