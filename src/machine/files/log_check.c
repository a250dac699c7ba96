/* Checks whether positions move as the velocities say. Changes of position over a few rows are compared with
 * the integral of the velocity (trapezoid) by correlation and slope, about the means, or about 0 for steady
 * motions. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/median.h"
#include "files/h5.h"
#include "machine/files/log_table.h"
#include "machine/files/recipe.h"
#include "liegrad/geometry.h"

enum { SHORT_SPAN = 32, FEWEST = 8, MANY_SPANS = 12, MOST_COMPARED = 100000 };
#define SLOPE_LOW   0.8
#define SLOPE_HIGH  1.25
#define SLOPE_FAR   1.6  /* over long spans, of which there are few, a slope is wrong from here on */
#define FITS        0.9  /* correlation of columns that belong together */
#define FITS_WELL   0.99 /* correlation from which on no other reading is tried */
#define UNRELATED   0.5
#define DEGREE      0.0174532925199433
#define STEADY      1e-12 /* variances below this part of the mean square are rounding */
#define ABOVE_NOISE 25    /* least ratio of a motion's variance to its noise's variance */
#define MOST_ANGLE  0.5   /* radians; bound on the change of attitude over a span of several rows */

/* How the columns of an attitude, or the velocities of a pose, are read; 0: as the machine's file says. */
enum { SCALAR_LAST = 1, INVERSE = 2, SPACE = 4, READINGS = 8 };
static const struct {
    unsigned bit;
    const char *is, *remedy;
} readings[] = {{SCALAR_LAST, "the quaternion is x, y, z, w", "name the columns in the order w, x, y, z"},
                {INVERSE, "the rotation maps space to body", "give its inverse (conjugate or transpose)"},
                {SPACE, "the rates are in the space frame", "give body rates (R^T omega)"}};

/* Compares position columns with velocity columns, `count` numbers each, over the parts of one file or of all
 * files. */
typedef struct check check;
struct check {
    lg_log_table *table;
    double *sorted;    /* (LG_LOG_SAMPLES) work space */
    bool *left_out;    /* (rows) rows that are not compared */
    uint32_t file;     /* file of the first part */
    size_t begin, end; /* parts begin .. end - 1 are compared */
    /* The first column and the number of columns; messages name them, and their noise is looked up. */
    uint32_t position, positions;
    uint32_t velocity, velocities;
    uint32_t attitude, attitudes; /* a pose's attitude columns, used when its place is compared */
    unsigned reading, possible;   /* how the columns are read; bits that other readings may have */
    int count;                    /* numbers that are compared: 1 or 3 */
    int lag;                      /* velocities are those of so many rows later */
    bool turns;                   /* y is a change of attitude */
    bool steady;                  /* correlation and slope are about 0, not about the means */
    bool overlap;                 /* a span begins every quarter of a span: long spans are few */
    lg_name_list q, v;            /* the names of the position's and of the velocity's columns */
    /* The velocity x in a row that should make the change of position. */
    void (*velocity_of)(const check *c, const double *row, double *x);
};

/* ---- sums ---- */

typedef struct sums {
    size_t n;
    int count;
    double x[3], y[3], xx, yy, xy, missed; /* missed: of (y - x)^2 */
} sums;

typedef struct fit {
    size_t n;
    /* Correlation of y with x; slope is the ratio of their standard deviations, with the correlation's
     * sign. */
    double correlation, slope;
    double y_variance, x_variance; /* per number */
    double moved, missed;          /* sums of y^2 and of (y - x)^2 */
} fit;

static void add(sums *s, const double *x, const double *y) {
    for (int i = 0; i < s->count; i++)
        if (!isfinite(x[i]) || !isfinite(y[i])) return;
    for (int i = 0; i < s->count; i++) {
        s->x[i] += x[i], s->y[i] += y[i];
        s->xx += x[i] * x[i], s->yy += y[i] * y[i], s->xy += x[i] * y[i];
        s->missed += (y[i] - x[i]) * (y[i] - x[i]);
    }
    s->n++;
}

static fit fit_of(const sums *s, bool steady) {
    const double n = (double)s->n;
    double xx = s->xx, yy = s->yy, xy = s->xy;
    for (int i = 0; i < s->count && !steady; i++) {
        xx -= s->x[i] * s->x[i] / n;
        yy -= s->y[i] * s->y[i] / n;
        xy -= s->x[i] * s->y[i] / n;
    }
    /* A variance as difference of sums keeps a little rounding error where nothing changes. */
    if (xx <= STEADY * s->xx) xx = 0;
    if (yy <= STEADY * s->yy) yy = 0;
    fit f = {.n = s->n,
             .y_variance = yy / (n * s->count),
             .x_variance = xx / (n * s->count),
             .moved = s->yy,
             .missed = s->missed};
    if (s->n > 0 && xx > 0 && yy > 0) {
        f.correlation = xy / sqrt(xx * yy);
        f.slope = copysign(sqrt(yy / xx), f.correlation);
    }
    return f;
}

/* ---- columns ---- */

static void scalar_velocity(const check *c, const double *row, double *x) {
    memcpy(x, row + c->velocity, (size_t)c->count * sizeof *x);
}

/* q' = omega x q. */
static void direction_velocity(const check *c, const double *row, double *x) {
    lg_cross3(row + c->velocity, row + c->position, x);
}

/* x' of a pose. The table has w, the velocity in the body, so that x' = R w. SPACE tries the other frame than
 * the file says. If the file says "space", the table has R^T times the log's numbers, which then were w
 * already: x' is R R times the table's. If it says "body", the table's numbers are x' themselves. */
static void pose_velocity(const check *c, const double *row, double *x) {
    const lg_machine_file *file = c->table->machine;
    double R[9], once[3];
    lg_log_rotation(row + c->attitude, c->attitudes, R);
    memcpy(x, row + c->velocity, 3 * sizeof *x);
    const bool space = file->coordinates[file->columns[c->position].index].space_frame;
    for (int times = c->reading != SPACE ? 1 : space ? 2 : 0; times > 0; times--) {
        memcpy(once, x, sizeof once);
        lg_so3_adjoint(R, once, x);
    }
}

static void rotation_at(const check *c, const double *row, double R[9]) {
    const double *q = row + c->position;
    const double reordered[4] = {q[3], q[0], q[1], q[2]};
    double as_given[9];
    lg_log_rotation((c->reading & SCALAR_LAST) != 0 ? reordered : q, c->positions, as_given);
    for (int i = 0; i < 9; i++) R[i] = as_given[(c->reading & INVERSE) != 0 ? i % 3 * 3 + i / 3 : i];
}

static void rotation_velocity(const check *c, const double *row, double *x) {
    double R[9];
    memcpy(x, row + c->velocity, 3 * sizeof *x);
    if ((c->reading & SPACE) == 0) return;
    rotation_at(c, row, R);
    lg_so3_coadjoint(R, row + c->velocity, x);
}

/* The change of position from row a to row b. */
static void change(const check *c, const double *a, const double *b, double *y) {
    double R[9], S[9];
    for (int i = 0; i < c->count && c->positions <= 3; i++)
        y[i] = b[c->position + (uint32_t)i] - a[c->position + (uint32_t)i];
    if (c->positions <= 3) return;
    rotation_at(c, a, R);
    rotation_at(c, b, S);
    lg_machine_turn_between(R, S, y);
}

static void velocity_at(const check *c, size_t row, double *x) {
    c->velocity_of(c, lg_log_row(c->table, row) + c->lag * (ptrdiff_t)c->table->columns, x);
}

/* Compares changes over `span` rows with integrals of the velocity. */
static fit compare(const check *c, size_t span) {
    const lg_log_table *table = c->table;
    const size_t stride = table->rows / MOST_COMPARED + (c->overlap ? (span + 3) / 4 : span),
                 early = c->lag < 0 ? (size_t)-c->lag : 0, late = span + (c->lag > 0 ? (size_t)c->lag : 0);
    sums s = {.count = c->count};
    for (size_t part = c->begin; part < c->end; part++) {
        for (size_t row = table->first[part] + early; row + late < table->first[part + 1]; row += stride) {
            double x[3] = {0, 0, 0}, y[3] = {0, 0, 0}, now[3], before[3];
            bool left_out = c->left_out[row];
            velocity_at(c, row, before);
            for (size_t i = 1; i <= span; i++) {
                const double h = lg_log_time(table, row + i) - lg_log_time(table, row + i - 1);
                velocity_at(c, row + i, now);
                for (int k = 0; k < c->count; k++) x[k] += h * (before[k] + now[k]) / 2;
                memcpy(before, now, sizeof before);
                left_out = left_out || c->left_out[row + i];
            }
            change(c, lg_log_row(table, row), lg_log_row(table, row + span), y);
            if (!left_out) add(&s, x, y);
        }
    }
    return fit_of(&s, c->steady);
}

/* ---- verdicts ---- */

static const char *path_of(const check *c) {
    return lg_shown_path(c->table->paths[c->file]);
}

/* The slope is wrong if both estimates of it, the regression of y on x and the inverse of the regression of x
 * on y, are too large, or both are too small. Negative slopes are wrong. */
static bool slope_is_wrong(const fit *f) {
    const double r = fabs(f->correlation);
    return r * f->slope > SLOPE_HIGH || f->slope / r < SLOPE_LOW;
}

static bool slope_is_right(const fit *f) {
    return f->slope > SLOPE_LOW && f->slope < SLOPE_HIGH;
}

static double noise_of(const check *c, uint32_t first, uint32_t count) {
    double most = 0;
    for (uint32_t i = first; i < first + count; i++) {
        const lg_log_statistics *s = &c->table->out->columns[i];
        /* For smooth columns the estimate is only an upper bound; their noise is far smaller. */
        const double noise = s->noise_at_most ? s->noise / 10 : s->noise;
        const double rounding = DBL_EPSILON * fmax(fabs(s->low), fabs(s->high));
        const lg_log_steps steps =
            lg_log_steps_of(c->table, i, c->table->first[c->begin], c->table->first[c->end], c->sorted);
        most = fmax(most, fmax(fmax(noise, rounding), steps.coarse ? steps.least / sqrt(12) : 0));
    }
    return most;
}

static bool is_coarse(const check *c, uint32_t first, uint32_t count) {
    const size_t *rows = c->table->first;
    for (uint32_t i = first; i < first + count; i++)
        if (lg_log_steps_of(c->table, i, rows[c->begin], rows[c->end], c->sorted).coarse) return true;
    return false;
}

/* The shortest span over which position and velocity change well above their noise. False: there is none. */
static bool find_span(const check *c, size_t *span, fit *f) {
    /* A rotation vector is twice the quaternion's vector part. */
    const double factor = c->positions == 4 ? 2 : 1;
    const double q = factor * noise_of(c, c->position, c->positions);
    const double v = noise_of(c, c->velocity, c->velocities) * c->table->out->dt_median;
    for (*span = 1;; *span *= 2) {
        *f = compare(c, *span);
        if (f->n < (*span <= SHORT_SPAN ? FEWEST : MANY_SPANS)) return false;
        if (c->turns && *span > 1 && f->y_variance * 3 > MOST_ANGLE * MOST_ANGLE) return false;
        if (f->y_variance > ABOVE_NOISE * 2 * q * q &&
            (f->x_variance > ABOVE_NOISE * v * v * (double)*span || f->x_variance == 0))
            return true;
    }
}

/* Whether x is `y` to `part` of it, or, where noise or few spans leave it unsure, as well as it is known. */
static bool is_near(const check *c, double x, double y, double part) {
    return fabs(x / y - 1.0) < (c->overlap ? SLOPE_HIGH - 1.0 : part);
}

static bool is_angle(const check *c) {
    const lg_log_column *q = &c->table->machine->columns[c->position];
    return c->turns || (c->positions == 1 &&
                        c->table->machine->machine.coordinates[q->index].kind == LG_COORDINATE_ANGLE);
}

/* A scale to propose: a power of ten if the measured one is near it, else the measured one. */
static double tidy_scale(const check *c, double scale) {
    const double tidy = copysign(pow(10.0, round(log10(fabs(scale)))), scale);
    return is_near(c, scale, tidy, 0.01) ? tidy : scale;
}

/* Proposes the scales that would mend the slope: of the velocities; of the position of a line or angle; of
 * the time if all coordinates are alike. Unless it is `sure`, a factor other than a sign or degrees is only a
 * warning. */
static lg_status wrong_slope(const check *c, const fit *f, bool sure) {
    const lg_log_column *columns = c->table->machine->columns, *at = &columns[c->position],
                        *time = &columns[c->table->machine->time];
    const bool degrees = is_angle(c) && is_near(c, fabs(f->slope), DEGREE, 0.05);
    char scale[3 * LG_LOG_NAME + 300] = "", text[sizeof c->table->error->message];
    if (c->positions == 1 && is_angle(c) && is_near(c, fabs(f->slope), 1 / DEGREE, 0.05))
        return lg_fail(c->table->error, LG_FORMAT,
                       "%s: column %s: it moves %.4g times as fast as column %s says: if it is in degrees, "
                       "set scale: {%s: %.6g}",
                       path_of(c), c->q.text, f->slope, c->v.text, c->q.text,
                       (f->slope < 0 ? -DEGREE : DEGREE) * at->scale);
    for (uint32_t i = c->velocity; i < c->velocity + c->velocities; i++)
        lg_append(scale, sizeof scale, "%s%s: %.6g", i > c->velocity ? ", " : "{", columns[i].name,
                  tidy_scale(c, (degrees ? copysign(DEGREE, f->slope) : f->slope) * columns[i].scale));
    lg_append(scale, sizeof scale, "}");
    if (c->positions == 1 && !degrees)
        lg_append(scale, sizeof scale, " or {%s: %.6g}", at->name, tidy_scale(c, at->scale / f->slope));
    if (f->slope > 0 && !degrees)
        lg_append(scale, sizeof scale, "; if all coordinates show this: {%s: %.6g}", time->name,
                  tidy_scale(c, f->slope * time->scale));
    const char *fault = degrees ? "velocity is in degrees" : f->slope < 0 ? "sign is wrong" : "unit is wrong";
    (void)lg_format(text, sizeof text,
                    "%s: column%s %s: the rate of %s is %.4g times %s: if the %s, set scale: %s", path_of(c),
                    c->velocities > 1 ? "s" : "", c->v.text, c->q.text, f->slope, c->v.text, fault, scale);
    if (sure || degrees || f->slope < 0) return lg_fail(c->table->error, LG_FORMAT, "%s", text);
    lg_log_warn(c->table, "%s", text);
    return LG_OK;
}

/* ---- failing sensors ---- */

/* The comparison without the rows that are marked to be left out; afterwards none is marked. */
static fit compare_rest(const check *c, size_t span) {
    const fit f = compare(c, span);
    memset(c->left_out, 0, c->table->rows * sizeof *c->left_out);
    return f;
}

/* Refuses a column with single values far off: without its jumps, position and velocity belong together. */
static lg_status refuse_outliers(const check *c, uint32_t column, uint32_t other) {
    static const double far = 20;
    const size_t first = c->table->first[c->begin], end = c->table->first[c->end], width = c->table->columns;
    const double *x = lg_log_row(c->table, 0) + column;
    size_t count = 0, at = 0;
    for (size_t row = first; row + 1 < end; row += (end - first) / LG_LOG_SAMPLES + 1) {
        const double size = fabs(x[(row + 1) * width] - x[row * width]);
        if (isfinite(size)) c->sorted[count++] = size;
    }
    const double jump = far * lg_median(c->sorted, count);
    count = 0;
    for (size_t part = c->begin; part < c->end && jump > 0; part++)
        for (size_t row = c->table->first[part] + 1; row < c->table->first[part + 1]; row++) {
            c->left_out[row] = fabs(x[row * width] - x[(row - 1) * width]) > jump;
            if (c->left_out[row] && count++ == 0) at = row;
        }
    const fit f = compare_rest(c, 1);
    if (count == 0 || f.correlation < FITS || !slope_is_right(&f)) return LG_OK;
    return LG_LOG_FAIL(c->table, at,
                       "column %s: jumps to %.6g; %zu steps are more than %.0f times the usual step, but "
                       "column %s does not show them: if these cells are outliers, leave them empty",
                       c->table->machine->columns[column].name, x[at * width], count, far,
                       c->table->machine->columns[other].name);
}

/* Refuses a column that often stands at its smallest or largest value, like a sensor at the end of its range.
 * A coarsely rounded column stands still everywhere; it is refused only if position and velocity belong
 * together far better without these rows. */
static lg_status refuse_clipped(const check *c, uint32_t column, size_t span, const fit *f) {
    enum { MANY = 10, PART = 100 };
    static const double better = 0.25;
    const lg_log_table *table = c->table;
    const size_t first = table->first[c->begin], end = table->first[c->end], rows = end - first;
    size_t count = 0;
    double low = INFINITY, high = -INFINITY;
    for (size_t row = first; row < end; row++) {
        const double x = lg_log_row(table, row)[column];
        low = fmin(low, x), high = fmax(high, x);
    }
    for (size_t row = first; row < end && low < high; row++) {
        const double x = lg_log_row(table, row)[column];
        c->left_out[row] = x == low || x == high;
        count += c->left_out[row];
    }
    const fit rest = compare_rest(c, span);
    if (count < MANY || count * PART < rows) return LG_OK;
    if (lg_log_steps_of(table, column, first, end, c->sorted).coarse &&
        (rest.n < FEWEST || !(1 - rest.correlation < better * (1 - f->correlation))))
        return LG_OK;
    return lg_fail(table->error, LG_FORMAT,
                   "%s: column %s: is at its smallest or largest value, %.6g and %.6g, in %zu of %zu rows: "
                   "if the sensor is at the end of its range, leave these cells empty",
                   path_of(c), table->machine->columns[column].name, low, high, count, rows);
}

/* Refuses lines and angles whose position and velocity do not belong together because a sensor fails. */
static lg_status refuse_failures(const check *c, size_t span, const fit *f) {
    if (c->positions != 1) return LG_OK;
    LG_TRY(refuse_outliers(c, c->position, c->velocity));
    /* Velocities may really jump, in an impact; the correlation is still high then, and they are not
     * refused. */
    if (f->correlation < UNRELATED) LG_TRY(refuse_outliers(c, c->velocity, c->position));
    LG_TRY(refuse_clipped(c, c->velocity, span, f));
    return refuse_clipped(c, c->position, span, f);
}

/* ---- other readings ---- */

/* Returns the reading of the columns that fits far better than theirs; 0 if no reading does. */
static unsigned better_reading(const check *c, size_t span, const fit *f) {
    unsigned best = 0;
    double most = 0;
    check other = *c;
    for (other.reading = 1; other.reading < READINGS; other.reading++) {
        if ((other.reading & ~c->possible) != 0) continue;
        const fit g = compare(&other, span);
        if (g.correlation < FITS || 1 - g.correlation > 0.1 * (1 - f->correlation)) continue;
        if (slope_is_right(&g) && g.correlation > most) most = g.correlation, best = other.reading;
    }
    return best;
}

static lg_status refuse_reading(const check *c, const char *columns, unsigned reading) {
    const lg_machine_file *file = c->table->machine;
    const char *frame = file->coordinates[file->columns[c->position].index].space_frame ? "body" : "space";
    char is[160] = "", remedy[160] = "";
    for (size_t i = 0; i < LG_COUNT(readings); i++) {
        if ((reading & readings[i].bit) == 0) continue;
        lg_append(is, sizeof is, "%s%s", is[0] != '\0' ? " and " : "", readings[i].is);
        lg_append(remedy, sizeof remedy, "%s%s", remedy[0] != '\0' ? ", and " : "", readings[i].remedy);
    }
    return c->positions > 3
               ? lg_fail(c->table->error, LG_FORMAT, "%s: %s: %s", columns, is, remedy)
               : lg_fail(c->table->error, LG_FORMAT, "%s: the velocities are in the %s frame: set frame: %s",
                         columns, frame, frame);
}

/* If the velocity of another line or angle fits better than `own` (a correlation, or 0), `hint` names it: "
 * Column vy fits"; else it is "". */
static void other_velocity(const check *c, size_t span, double own, char *hint, size_t size) {
    static const double clearly = 0.5;
    const lg_machine_file *file = c->table->machine;
    hint[0] = '\0';
    for (uint32_t i = 0; i < file->machine.coordinate_count; i++) {
        const lg_log_coordinate *where = &file->coordinates[i];
        check other = *c;
        if (where->velocities != 1 || where->velocity == c->velocity) continue;
        other.velocity = where->velocity;
        const fit f = compare(&other, span);
        if (f.correlation < FITS || !slope_is_right(&f)) continue;
        if (!(1 - f.correlation < clearly * (1 - own))) continue;
        (void)snprintf(hint, size, " Column %s fits", file->columns[where->velocity].name);
        return;
    }
}

/* Looks for longer spans, up to a third of a part, over which position and velocity belong together:
 * vibration or noise of one sensor hides the motion over a few rows, but not over many. *span and *f become
 * the span and the comparison with the best fit. If no span agrees, they become those with the clearest
 * wrong slope, which MANY_SPANS beside each other must show, or fewer that fit well. Returns false if no span
 * is clear. Also returns false if the velocity of another coordinate fits better over one of the spans;
 * `hint` then names it. Over the other spans, a motion that both coordinates share may hide that columns are
 * swapped. */
static bool clear_longer(const check *c, size_t *span, fit *f, char *hint, size_t size) {
    bool agree = false, clear = false;
    for (size_t rows = 2 * *span;; rows += rows / 2) {
        const fit longer = compare(c, rows);
        const bool turned = c->turns && longer.y_variance * 3 > MOST_ANGLE * MOST_ANGLE;
        if (longer.n < FEWEST || turned) return clear;
        if (c->positions == 1) other_velocity(c, rows, fmax(longer.correlation, 0), hint, size);
        if (hint[0] != '\0') return false;
        const bool right = slope_is_right(&longer),
                   wrong = !agree && (longer.slope < 1 / SLOPE_FAR || longer.slope > SLOPE_FAR) &&
                           (longer.n >= 4 * (MANY_SPANS - 1) || fabs(longer.correlation) > FITS_WELL);
        if (fabs(longer.correlation) < FITS || !(right || wrong)) continue;
        if (clear && agree == right && fabs(longer.correlation) < fabs(f->correlation)) continue;
        clear = true, agree = right;
        *span = rows;
        *f = longer;
    }
}

static lg_status judge(check *c) {
    size_t span = 1;
    fit f = {0};
    char hint[LG_LOG_NAME + 20] = "", columns[LG_LOG_SENTENCE];
    lg_log_names_of(c->table, c->position, c->positions, &c->q);
    lg_log_names_of(c->table, c->velocity, c->velocities, &c->v);
    c->steady = !find_span(c, &span, &f);
    const bool seen = !c->steady || find_span(c, &span, &f);
    if (!seen && (is_coarse(c, c->position, c->positions) || is_coarse(c, c->velocity, c->velocities)))
        return LG_OK;
    if (!seen) span = 1, f = (fit){0}, c->steady = false; /* Longer spans may still show the motion. */
    if (seen && (f.correlation < FITS_WELL || slope_is_wrong(&f))) LG_TRY(refuse_failures(c, span, &f));
    if (fabs(f.correlation) > FITS_WELL) return slope_is_wrong(&f) ? wrong_slope(c, &f, true) : LG_OK;
    unsigned better = better_reading(c, span, &f);
    const fit first = f;
    const bool fits = fabs(f.correlation) > FITS;
    if (!fits && c->positions == 1) other_velocity(c, span, 0, hint, sizeof hint);
    c->overlap = true;
    const bool clear =
        !fits && better == 0 && hint[0] == '\0' && clear_longer(c, &span, &f, hint, sizeof hint);
    if (clear) better = better_reading(c, span, &f);
    (void)lg_format(columns, sizeof columns, "%s: columns %s and %s", path_of(c), c->q.text, c->v.text);
    if (better != 0) return refuse_reading(c, columns, better);
    if ((fits || clear) && slope_is_wrong(&f))
        return wrong_slope(c, &f, fits || (seen && first.correlation < UNRELATED));
    if (fits || !seen) return LG_OK;
    if (!clear && (f.correlation < UNRELATED || hint[0] != '\0'))
        return lg_fail(c->table->error, LG_FORMAT,
                       "%s do not belong together (correlation %.2f): are columns swapped?%s", columns,
                       f.correlation, hint);
    if (clear)
        lg_log_warn(c->table,
                    "%s agree over %zu rows (correlation %.2f), but not over fewer (%.2f): one of them "
                    "vibrates or is noisy",
                    columns, span, f.correlation, first.correlation);
    else
        lg_log_warn(c->table, "%s fit badly (correlation %.2f): check them", columns, f.correlation);
    return LG_OK;
}

/* Returns how many comparisons a coordinate needs: of a pose two. */
static uint32_t list_checks(const check *where, uint32_t index, check out[2]) {
    const lg_log_coordinate *w = &where->table->machine->coordinates[index];
    const bool pose = w->places > 0 && w->attitudes > 0;
    check place = *where, attitude = *where;
    uint32_t count = 0;
    place.position = w->place, place.positions = place.velocities = w->places, place.count = (int)w->places;
    place.attitude = w->attitude, place.attitudes = w->attitudes;
    place.velocity = w->velocity, place.velocity_of = pose ? pose_velocity : scalar_velocity;
    place.possible = pose ? SPACE : 0;
    attitude.position = w->attitude, attitude.positions = w->attitudes, attitude.velocities = 3;
    attitude.velocity = w->velocity + (w->velocities - 3), attitude.count = 3, attitude.turns = true;
    attitude.velocity_of = w->attitudes == 3 ? direction_velocity : rotation_velocity;
    attitude.possible = w->attitudes == 3 ? 0 : w->attitudes == 4 ? READINGS - 1 : INVERSE | SPACE;
    if (w->attitudes > 0) out[count++] = attitude;
    if (w->places > 0) out[count++] = place;
    return count;
}

static lg_status check_parts(const check *where) {
    check of[2];
    for (uint32_t i = 0; i < where->table->machine->machine.coordinate_count; i++) {
        const uint32_t count = list_checks(where, i, of);
        for (uint32_t k = 0; k < count; k++) LG_TRY(judge(&of[k]));
    }
    return LG_OK;
}

/* ---- two clocks ---- */

/* What the velocities `lag` rows later leave of the motion of each coordinate from row to row. */
static void find_motions(const check *where, int lag, double *out) {
    check of[2];
    for (uint32_t i = 0; i < where->table->machine->machine.coordinate_count; i++) {
        double moved = 0, missed = 0;
        for (uint32_t k = list_checks(where, i, of); k-- > 0;) {
            of[k].lag = lag;
            const fit f = compare(&of[k], 1);
            moved += f.moved, missed += f.missed;
        }
        out[i] = moved > 0 ? sqrt(missed / moved) : NAN;
    }
}

/* A lag is accepted if its velocities leave less than half of what the velocities of the same rows leave;
 * velocities of other rows do not reach this by chance. */
static void find_lags(const check *where, lg_logs *out) {
    enum { MOST = 12 };
    static const double better = 0.5;
    const uint32_t n = where->table->machine->machine.coordinate_count;
    double each[LG_MACHINE_COORDINATES];
    find_motions(where, 0, out->motion);
    for (uint32_t i = 0; i < n; i++) out->left[i] = better * out->motion[i];
    for (int k = -MOST; k <= MOST; k++) {
        find_motions(where, k, each);
        for (uint32_t i = 0; i < n; i++)
            if (each[i] < out->left[i]) out->left[i] = each[i], out->lag[i] = k;
    }
}

/* ---- lines and angles from row to row ---- */

/* The change of the position to the next row, wrapped if it is an angle; *way: the velocity's integral. */
static double change_after(const check *c, bool angle, size_t row, double *way) {
    const double *a = lg_log_row(c->table, row), *b = lg_log_row(c->table, row + 1);
    const double moved = b[c->position] - a[c->position];
    *way =
        (lg_log_time(c->table, row + 1) - lg_log_time(c->table, row)) * (a[c->velocity] + b[c->velocity]) / 2;
    return angle ? lg_machine_wrap(moved) : moved;
}

/* A position stands still if it keeps its value while the velocity goes `far` usual changes: coarsely rounded
 * positions stand still only until they have moved by one rounding step. */
static void look_at_rows(const check *c, bool angle, double *noise, lg_standstill *worst) {
    static const double far = 6.0;
    const size_t *first = c->table->first, stride = c->table->rows / LG_LOG_SAMPLES + 1;
    double sum = 0.0, way;
    size_t count = 0, products = 0, changes = 0; /* at most LG_LOG_SAMPLES of all changes are sorted */
    for (size_t p = 0; p < c->table->parts; p++)
        for (size_t row = first[p]; row + 1 < first[p + 1]; row++) {
            if (changes++ % stride != 0) continue;
            const double size = fabs(change_after(c, angle, row, &way));
            if (size > 0.0) c->sorted[count++] = size;
        }
    const double usual = lg_median(c->sorted, count);
    for (size_t p = 0; p < c->table->parts; p++) {
        double gone = 0.0, before = NAN;
        size_t since = first[p];
        for (size_t row = since; row + 1 < first[p + 1]; row++) {
            const double moved = change_after(c, angle, row, &way), off = moved - way;
            if (isfinite(off * before)) sum += off * before, products++;
            before = off;
            if (moved != 0.0)
                since = row + 1, gone = 0.0;
            else if (fabs(gone += way) > far * usual && row + 2 - since > worst->rows)
                *worst = (lg_standstill){since, row + 2 - since, lg_log_row(c->table, row)[c->position]};
        }
    }
    *noise = products > 0 && sum < 0.0 ? sqrt(-sum / (double)products) : 0.0;
}

static void look_at_coordinates(const check *where) {
    const lg_machine *machine = &where->table->machine->machine;
    lg_logs *out = where->table->out;
    check of[2];
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (list_checks(where, i, of) > 0 && of[0].positions == 1)
            look_at_rows(of, machine->coordinates[i].kind == LG_COORDINATE_ANGLE, &out->position_noise[i],
                         &out->stuck[i]);
}

/* Checks each file alone, so that the message names the file at fault, then all files together. */
static lg_status check_files(check where) {
    const lg_log_table *table = where.table;
    while (where.begin < table->parts) {
        where.file = table->origin[table->first[where.begin]].file;
        for (where.end = where.begin + 1; where.end < table->parts; where.end++)
            if (table->origin[table->first[where.end]].file != where.file) break;
        LG_TRY(check_parts(&where));
        where.begin = where.end;
    }
    where.begin = 0, where.file = table->origin[0].file;
    return table->origin[table->rows - 1].file != where.file ? check_parts(&where) : LG_OK;
}

lg_status lg_log_check(lg_log_table *table) {
    for (uint32_t i = 0; i < LG_MACHINE_COORDINATES; i++) table->out->motion[i] = NAN;
    if (table->machine->measured != LG_MEASURED_VELOCITIES) return LG_OK;
    LG_TRY_SCRATCH(double, sorted, table->context, LG_LOG_SAMPLES, lg_log_no_memory(table));
    LG_TRY_SCRATCH(bool, left_out, table->context, table->rows, lg_log_no_memory(table));
    check where = {.table = table, .sorted = sorted, .left_out = left_out};
    LG_TRY(check_files(where));
    where.end = table->parts;
    look_at_coordinates(&where);
    if (table->options->clocks) find_lags(&where, table->out);
    return LG_OK;
}
