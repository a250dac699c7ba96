/* Checks whether positions move as the velocities say. Changes of position over a few rows are compared with
 * the integral of the velocity (trapezoid) by correlation and slope, about the means, or about 0 for steady
 * motions. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/median.h"
#include "files/h5.h"
#include "machine/files/log_table.h"
#include "liegrad/geometry.h"

enum { SHORT_SPAN = 32, FEWEST = 8, MANY_SPANS = 12, MOST_COMPARED = 100000 };
#define SLOPE_LOW   0.8
#define SLOPE_HIGH  1.25
#define FITS        0.9  /* correlation of columns that belong together */
#define FITS_WELL   0.99 /* correlation from which on no other reading is tried */
#define UNRELATED   0.5
#define DEGREE      0.0174532925199433
#define STEADY      1e-12 /* variances below this part of the mean square are rounding */
#define ABOVE_NOISE 25    /* least ratio of a motion's variance to its noise's variance */
#define MOST_ANGLE  0.5   /* radians; bound on the change of attitude over a span of several rows */

/* A way to read the columns. The first way of a list is the way of the machine's file. */
typedef struct way {
    bool scalar_last; /* the quaternion is stored as x, y, z, w */
    bool inverse;     /* the rotation is space to body */
    bool space;       /* rates are in space; for a pose's velocity: in the other frame than the file says */
    const char *words;
} way;

static const way rotation_ways[] = {
    {false, false, false, ""},
    {false, false, true, "the rates are in the space frame: give body rates (R^T omega)"},
    {true, false, false, "the quaternion is x, y, z, w: name its columns in the order w, x, y, z"},
    {true, false, true,
     "the quaternion is x, y, z, w and the rates are in the space frame: name the columns in the order w, x, "
     "y, z, and give body rates"},
    {false, true, false, "the rotation maps space to body: give its inverse (conjugate or transpose)"},
    {false, true, true,
     "the rotation maps space to body and the rates are in the space frame: give the inverse rotation and "
     "body rates"},
    {true, true, false,
     "the quaternion is x, y, z, w and maps space to body: name the columns in the order w, x, y, z and give "
     "the conjugate"},
    {true, true, true,
     "the quaternion is x, y, z, w and maps space to body, and the rates are in the space frame: give w, x, "
     "y, z of the conjugate, and body rates"},
};

/* Compares position columns with velocity columns, `count` numbers each, over the parts of one file or of all
 * files. */
typedef struct check check;
struct check {
    lg_log_table *table;
    double *sorted;    /* (LG_LOG_SAMPLES) work space */
    uint32_t file;     /* file of the first part */
    size_t begin, end; /* parts begin .. end - 1 are compared */
    /* The first column and the number of columns; messages name them, and their noise is looked up. */
    uint32_t position, positions;
    uint32_t velocity, velocities;
    uint32_t attitude, attitudes; /* a pose's attitude columns, used when its place is compared */
    const way *ways;              /* (way_count) */
    size_t way_count;
    int count;        /* numbers that are compared: 1 or 3 */
    int lag;          /* velocities are those of so many rows later */
    bool turns;       /* y is a rotation vector */
    bool steady;      /* correlation and slope are about 0, not about the means */
    bool overlap;     /* a span begins every quarter of a span: long spans are few */
    uint32_t watched; /* rows are left out of the comparison where this column ... */
    double jump;      /* ... changes by more than this to the next row; 0: not used */
    double low, high; /* ... or equals one of these; not used if low >= high */
    /* `change` computes the change y of position from row a to row b, `velocity_of` the velocity x in a row
     * that should make this change. */
    void (*change)(const check *c, const way *w, const double *a, const double *b, double *y);
    void (*velocity_of)(const check *c, const way *w, const double *row, double *x);
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

/* Whether the watched column jumps from `row` to the next row. */
static bool is_jump(const check *c, size_t row) {
    const double *here = lg_log_row(c->table, row) + c->watched;
    return c->jump > 0 && fabs(here[c->table->columns] - *here) > c->jump;
}

static bool is_clipped(const check *c, size_t row) {
    const double x = lg_log_row(c->table, row)[c->watched];
    return c->low < c->high && (x == c->low || x == c->high);
}

static void velocity_at(const check *c, const way *w, size_t row, double *x) {
    c->velocity_of(c, w, lg_log_row(c->table, row) + c->lag * (ptrdiff_t)c->table->columns, x);
}

/* Compares changes over `span` rows with integrals of the velocity. */
static fit compare(const check *c, const way *w, size_t span) {
    const lg_log_table *table = c->table;
    const size_t stride = table->rows / MOST_COMPARED + (c->overlap ? (span + 3) / 4 : span),
                 early = c->lag < 0 ? (size_t)-c->lag : 0, late = span + (c->lag > 0 ? (size_t)c->lag : 0);
    sums s = {.count = c->count};
    for (size_t part = c->begin; part < c->end; part++) {
        for (size_t row = table->first[part] + early; row + late < table->first[part + 1]; row += stride) {
            double x[3] = {0, 0, 0}, y[3] = {0, 0, 0}, now[3], before[3];
            bool left_out = is_clipped(c, row);
            velocity_at(c, w, row, before);
            for (size_t i = 1; i <= span; i++) {
                const double h = lg_log_time(table, row + i) - lg_log_time(table, row + i - 1);
                velocity_at(c, w, row + i, now);
                for (int k = 0; k < c->count; k++) x[k] += h * (before[k] + now[k]) / 2;
                memcpy(before, now, sizeof before);
                left_out = left_out || is_clipped(c, row + i) || is_jump(c, row + i - 1);
            }
            c->change(c, w, lg_log_row(table, row), lg_log_row(table, row + span), y);
            if (!left_out) add(&s, x, y);
        }
    }
    return fit_of(&s, c->steady);
}

/* ---- columns ---- */

static void scalar_change(const check *c, const way *w, const double *a, const double *b, double *y) {
    (void)w;
    for (int i = 0; i < c->count; i++) y[i] = b[c->position + (uint32_t)i] - a[c->position + (uint32_t)i];
}

static void scalar_velocity(const check *c, const way *w, const double *row, double *x) {
    (void)w;
    for (int i = 0; i < c->count; i++) x[i] = row[c->velocity + (uint32_t)i];
}

/* q' = omega x q. */
static void direction_velocity(const check *c, const way *w, const double *row, double *x) {
    (void)w;
    lg_cross3(row + c->velocity, row + c->position, x);
}

/* x' of a pose. The table has w, the velocity in the body, so that x' = R w. w->space tries the other frame
 * than the file says. If the file says "space", the table has R^T times the log's numbers, which then were w
 * already: x' is R R times the table's. If it says "body", the table's numbers are x' themselves. */
static void pose_velocity(const check *c, const way *w, const double *row, double *x) {
    double R[9], once[3];
    lg_log_rotation(row + c->attitude, c->attitudes, R);
    lg_so3_adjoint(R, row + c->velocity, once);
    memcpy(x, once, sizeof once);
    if (!w->space) return;
    const lg_machine_file *file = c->table->machine;
    if (file->coordinates[file->columns[c->position].index].space_frame)
        lg_so3_adjoint(R, once, x);
    else
        memcpy(x, row + c->velocity, sizeof once);
}

static void rotation_at(const check *c, const way *w, const double *row, double R[9]) {
    const double *q = row + c->position;
    const double reordered[4] = {q[3], q[0], q[1], q[2]};
    double inverse[9];
    lg_log_rotation(w->scalar_last ? reordered : q, c->positions, R);
    if (!w->inverse) return;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) inverse[3 * i + j] = R[3 * j + i];
    memcpy(R, inverse, sizeof inverse);
}

static void rotation_change(const check *c, const way *w, const double *a, const double *b, double *y) {
    double R[9], S[9], D[9];
    rotation_at(c, w, a, R);
    rotation_at(c, w, b, S);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) D[3 * i + j] = R[i] * S[j] + R[3 + i] * S[3 + j] + R[6 + i] * S[6 + j];
    lg_so3_log(D, y);
}

static void rotation_velocity(const check *c, const way *w, const double *row, double *x) {
    double R[9];
    memcpy(x, row + c->velocity, 3 * sizeof *x);
    if (!w->space) return;
    rotation_at(c, w, row, R);
    lg_so3_coadjoint(R, row + c->velocity, x);
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

/* The shortest span over which position and velocity change well above their noise. False: there is none. */
static bool find_span(const check *c, const way *w, size_t *span, fit *f) {
    /* A rotation vector is twice the quaternion's vector part. */
    const double factor = c->positions == 4 ? 2 : 1;
    const double q = factor * noise_of(c, c->position, c->positions);
    const double v = noise_of(c, c->velocity, c->velocities) * c->table->out->dt_median;
    for (*span = 1;; *span *= 2) {
        *f = compare(c, w, *span);
        if (f->n < (*span <= SHORT_SPAN ? FEWEST : MANY_SPANS)) return false;
        if (c->turns && *span > 1 && f->y_variance * 3 > MOST_ANGLE * MOST_ANGLE) return false;
        if (f->y_variance > ABOVE_NOISE * 2 * q * q &&
            (f->x_variance > ABOVE_NOISE * v * v * (double)*span || f->x_variance == 0))
            return true;
    }
}

/* Whether an angle moves 180/pi times as fast as its rate: it is in degrees. */
static bool is_degrees(const check *c, const fit *f) {
    const lg_log_column *q = &c->table->machine->columns[c->position];
    return c->positions == 1 &&
           c->table->machine->machine.coordinates[q->index].kind == LG_COORDINATE_ANGLE &&
           fabs(fabs(f->slope) * DEGREE - 1) < 0.05;
}

/* A scale to propose: a power of ten if the measured one is within 1 % of it, else the measured one. */
static double tidy_scale(double scale) {
    const double tidy = copysign(pow(10.0, round(log10(fabs(scale)))), scale);
    return fabs(scale / tidy - 1.0) < 0.01 ? tidy : scale;
}

/* Other scales that would mend the slope, as text: " or {x: 0.001}" for the position of a line or angle, and
 * for the time if all coordinates are alike. */
static void other_scale(const check *c, const fit *f, char *text, size_t size) {
    const lg_log_column *q = &c->table->machine->columns[c->position];
    const lg_log_column *t = &c->table->machine->columns[c->table->machine->time];
    text[0] = '\0';
    if (c->positions == 1) lg_append(text, size, " or {%s: %.6g}", q->name, tidy_scale(q->scale / f->slope));
    if (f->slope > 0)
        lg_append(text, size, "; if all coordinates show this: {%s: %.6g}", t->name,
                  tidy_scale(f->slope * t->scale));
}

static lg_status wrong_slope(const check *c, const fit *f) {
    const lg_log_column *column = &c->table->machine->columns[c->velocity];
    lg_name_list q, v;
    char scale[200] = "", other[2 * LG_LOG_NAME + 96];
    lg_log_names_of(c->table, c->position, c->positions, &q);
    lg_log_names_of(c->table, c->velocity, c->velocities, &v);
    if (is_degrees(c, f))
        return lg_fail(c->table->error, LG_FORMAT,
                       "%s: column %s: it moves %.4g times as fast as column %s says: if it is in degrees, "
                       "set scale: {%s: %.6g}",
                       path_of(c), q.text, f->slope, v.text, q.text,
                       (f->slope < 0 ? -DEGREE : DEGREE) * c->table->machine->columns[c->position].scale);
    for (uint32_t i = 0; i < c->velocities; i++)
        lg_append(scale, sizeof scale, "%s%s: %.6g", i > 0 ? ", " : "", column[i].name,
                  tidy_scale(f->slope * column[i].scale));
    other_scale(c, f, other, sizeof other);
    return lg_fail(c->table->error, LG_FORMAT,
                   "%s: column%s %s: the rate of %s is %.4g times %s: if the %s is wrong, set scale: {%s}%s",
                   path_of(c), c->velocities > 1 ? "s" : "", v.text, q.text, f->slope, v.text,
                   f->slope < 0 ? "sign" : "unit", scale, other);
}

/* ---- failing sensors ---- */

/* The median change, in absolute value, of the watched column from row to row; NaN if every second row lacks
 * the column. */
static double usual_change(const check *c) {
    const size_t first = c->table->first[c->begin], end = c->table->first[c->end];
    size_t count = 0;
    for (size_t row = first; row + 1 < end; row += (end - first) / LG_LOG_SAMPLES + 1) {
        const double *here = lg_log_row(c->table, row) + c->watched;
        const double size = fabs(here[c->table->columns] - *here);
        if (isfinite(size)) c->sorted[count++] = size;
    }
    return lg_median(c->sorted, count);
}

/* Counts the jumps of the watched column; `first` gets the row after the first jump. */
static size_t count_jumps(const check *c, size_t *first) {
    size_t count = 0;
    for (size_t part = c->begin; part < c->end; part++)
        for (size_t row = c->table->first[part]; row + 1 < c->table->first[part + 1]; row++)
            if (is_jump(c, row) && count++ == 0) *first = row + 1;
    return count;
}

/* Refuses a column with single values far off: without its jumps, position and velocity belong together. */
static lg_status refuse_outliers(const check *c, const way *w, uint32_t column, uint32_t other) {
    static const double far = 20;
    check without = *c;
    size_t row = 0;
    without.watched = column;
    without.jump = far * usual_change(&without);
    const size_t count = count_jumps(&without, &row);
    const fit f = compare(&without, w, 1);
    if (count == 0 || f.correlation < FITS || !slope_is_right(&f)) return LG_OK;
    return lg_log_fail(c->table, row,
                       "column %s: jumps to %.6g; %zu steps are more than %.0f times the usual step, but "
                       "column %s does not show them: if these cells are outliers, leave them empty",
                       c->table->machine->columns[column].name, lg_log_row(c->table, row)[column], count, far,
                       c->table->machine->columns[other].name);
}

/* Refuses a column that often stands at its smallest or largest value, like a sensor at the end of its range.
 * A coarsely rounded column stands still everywhere; it is refused only if position and velocity belong
 * together far better without these rows. */
static lg_status refuse_clipped(const check *c, const way *w, uint32_t column, size_t span, const fit *f) {
    enum { MANY = 10, PART = 100 };
    static const double better = 0.25;
    const lg_log_table *table = c->table;
    const size_t first = table->first[c->begin], end = table->first[c->end], rows = end - first;
    check without = *c;
    size_t count = 0;
    without.watched = column, without.low = INFINITY, without.high = -INFINITY;
    for (size_t row = first; row < end; row++) {
        const double x = lg_log_row(table, row)[column];
        without.low = fmin(without.low, x), without.high = fmax(without.high, x);
    }
    for (size_t row = first; row < end; row++) count += is_clipped(&without, row);
    if (count < MANY || count * PART < rows) return LG_OK;
    const fit rest = compare(&without, w, span);
    if (lg_log_steps_of(table, column, first, end, c->sorted).coarse &&
        (rest.n < FEWEST || !(1 - rest.correlation < better * (1 - f->correlation))))
        return LG_OK;
    return lg_fail(c->table->error, LG_FORMAT,
                   "%s: column %s: is at its smallest or largest value, %.6g and %.6g, in %zu of %zu rows: "
                   "if the sensor is at the end of its range, leave these cells empty",
                   path_of(c), table->machine->columns[column].name, without.low, without.high, count, rows);
}

/* Refuses lines and angles whose position and velocity do not belong together because a sensor fails. */
static lg_status refuse_failures(const check *c, const way *w, size_t span, const fit *f) {
    if (c->positions != 1) return LG_OK;
    LG_TRY(refuse_outliers(c, w, c->position, c->velocity));
    /* Velocities may really jump, in an impact; the correlation is still high then, and they are not
     * refused. */
    if (f->correlation < UNRELATED) LG_TRY(refuse_outliers(c, w, c->velocity, c->position));
    LG_TRY(refuse_clipped(c, w, c->velocity, span, f));
    return refuse_clipped(c, w, c->position, span, f);
}

/* Another way of reading the columns that fits far better; NULL: none. */
static const way *better_way(const check *c, size_t span, const fit *f) {
    const way *best = NULL, *ways = c->ways;
    double most = 0;
    for (size_t i = 1; i < c->way_count; i++) {
        if (ways[i].scalar_last && c->positions != 4) continue;
        const fit other = compare(c, &ways[i], span);
        if (other.correlation < FITS || 1 - other.correlation > 0.1 * (1 - f->correlation)) continue;
        if (slope_is_right(&other) && other.correlation > most) most = other.correlation, best = &ways[i];
    }
    return best;
}

/* If the velocity of another line or angle fits better than `own` (a correlation, or 0), `hint` names it: "
 * Column vy fits"; else it is "". */
static void other_velocity(const check *c, size_t span, double own, char *hint, size_t size) {
    static const way plain = {.words = ""};
    static const double clearly = 0.5;
    const lg_machine_file *file = c->table->machine;
    hint[0] = '\0';
    for (uint32_t i = 0; i < file->machine.coordinate_count; i++) {
        const lg_log_coordinate *where = &file->coordinates[i];
        check other = *c;
        if (where->velocities != 1 || where->velocity == c->velocity) continue;
        other.velocity = where->velocity;
        const fit f = compare(&other, &plain, span);
        if (f.correlation < FITS || !slope_is_right(&f)) continue;
        if (!(1 - f.correlation < clearly * (1 - own))) continue;
        (void)snprintf(hint, size, " Column %s fits", file->columns[where->velocity].name);
        return;
    }
}

/* Looks for longer spans, up to a third of a part, over which position and velocity belong together:
 * vibration or noise of one sensor hides the motion over a few rows, but not over many. *span and *f become
 * the span and the comparison with the best fit. Returns false if no span fits. Also returns false if the
 * velocity of another coordinate fits better over one of the spans; `hint` then names it. Over the other
 * spans, a motion that both coordinates share may hide that columns are swapped. */
static bool agree_longer(const check *c, const way *w, size_t *span, fit *f, char *hint, size_t size) {
    bool agree = false;
    for (size_t rows = 2 * *span;; rows += rows / 2) {
        const fit longer = compare(c, w, rows);
        const bool turned = c->turns && longer.y_variance * 3 > MOST_ANGLE * MOST_ANGLE;
        if (longer.n < FEWEST || turned) return agree;
        if (c->positions == 1) other_velocity(c, rows, fmax(longer.correlation, 0), hint, size);
        if (hint[0] != '\0') return false;
        if (longer.correlation < FITS || !slope_is_right(&longer)) continue;
        if (agree && longer.correlation < f->correlation) continue;
        agree = true;
        *span = rows;
        *f = longer;
    }
}

static lg_status judge(check *c) {
    const way *ways = c->ways;
    size_t span = 1;
    fit f = {0};
    char hint[LG_LOG_NAME + 20] = "";
    bool found = find_span(c, &ways[0], &span, &f);
    if (!found) {
        c->steady = true;
        found = find_span(c, &ways[0], &span, &f);
    }
    if (!found) return LG_OK;
    if (f.correlation < FITS_WELL || slope_is_wrong(&f)) LG_TRY(refuse_failures(c, &ways[0], span, &f));
    if (fabs(f.correlation) > FITS_WELL) return slope_is_wrong(&f) ? wrong_slope(c, &f) : LG_OK;
    const way *better = better_way(c, span, &f);
    const fit first = f;
    const bool fits = fabs(f.correlation) > FITS;
    if (!fits && c->positions == 1) other_velocity(c, span, 0, hint, sizeof hint);
    c->overlap = true;
    const bool agree =
        !fits && better == NULL && hint[0] == '\0' && agree_longer(c, &ways[0], &span, &f, hint, sizeof hint);
    if (agree) better = better_way(c, span, &f);
    lg_name_list q, v;
    lg_log_names_of(c->table, c->position, c->positions, &q);
    lg_log_names_of(c->table, c->velocity, c->velocities, &v);
    if (better != NULL)
        return lg_fail(c->table->error, LG_FORMAT, "%s: columns %s and %s: %s", path_of(c), q.text, v.text,
                       better->words);
    if (fits) return slope_is_wrong(&f) ? wrong_slope(c, &f) : LG_OK;
    if (!agree && (f.correlation < UNRELATED || hint[0] != '\0'))
        return lg_fail(
            c->table->error, LG_FORMAT,
            "%s: columns %s and %s do not belong together (correlation %.2f): are columns swapped?%s",
            path_of(c), q.text, v.text, f.correlation, hint);
    if (agree)
        lg_log_warn(
            c->table,
            "%s: columns %s and %s agree over %zu rows (correlation %.2f), but not over fewer (%.2f): "
            "one of them vibrates or is noisy",
            path_of(c), q.text, v.text, span, f.correlation, first.correlation);
    else
        lg_log_warn(c->table, "%s: columns %s and %s fit badly (correlation %.2f): check them", path_of(c),
                    q.text, v.text, f.correlation);
    return LG_OK;
}

static const way plain_ways[] = {{.words = ""}};
static const way body_ways[] = {
    {.words = ""}, {.space = true, .words = "the velocities are in the space frame: set frame: space"}};
static const way space_ways[] = {
    {.words = ""}, {.space = true, .words = "the velocities are in the body frame: set frame: body"}};

/* Returns how many comparisons a coordinate needs: one, or of a pose two. */
static uint32_t list_checks(const check *where, uint32_t index, check out[2]) {
    const lg_log_coordinate *w = &where->table->machine->coordinates[index];
    const lg_coordinate_kind kind = where->table->machine->machine.coordinates[index].kind;
    check place = *where, attitude = *where;
    place.ways = attitude.ways = plain_ways, place.way_count = attitude.way_count = LG_COUNT(plain_ways);
    place.position = w->place, place.positions = w->places;
    place.velocity = w->velocity, place.velocities = w->places;
    place.attitude = w->attitude, place.attitudes = w->attitudes;
    place.count = (int)w->places;
    place.change = scalar_change, place.velocity_of = scalar_velocity;
    attitude.position = w->attitude, attitude.positions = w->attitudes;
    attitude.velocity = w->velocity + (w->velocities - 3), attitude.velocities = 3;
    attitude.count = 3, attitude.turns = true;
    attitude.change = rotation_change, attitude.velocity_of = rotation_velocity;
    out[0] = kind == LG_COORDINATE_LINE || kind == LG_COORDINATE_ANGLE ? place : attitude;
    if (kind == LG_COORDINATE_DIRECTION)
        out[0].change = scalar_change, out[0].velocity_of = direction_velocity;
    if (kind <= LG_COORDINATE_DIRECTION) return 1;
    out[0].ways = rotation_ways, out[0].way_count = LG_COUNT(rotation_ways);
    out[1] = place;
    out[1].velocity_of = pose_velocity;
    out[1].ways = w->space_frame ? space_ways : body_ways, out[1].way_count = LG_COUNT(body_ways);
    return kind == LG_COORDINATE_POSE ? 2 : 1;
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
            const fit f = compare(&of[k], of[k].ways, 1);
            moved += f.moved, missed += f.missed;
        }
        out[i] = moved > 0 ? sqrt(missed / moved) : (double)NAN;
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
    for (uint32_t i = 0; i < LG_MACHINE_COORDINATES; i++) table->out->motion[i] = (double)NAN;
    if (table->machine->measured != LG_MEASURED_VELOCITIES) return LG_OK;
    double *sorted = lg_alloc(table->context, LG_LOG_SAMPLES, sizeof *sorted);
    if (sorted == NULL) return lg_log_no_memory(table);
    const lg_status status = check_files((check){.table = table, .sorted = sorted});
    if (status == LG_OK && table->options->clocks)
        find_lags(&(check){.table = table, .end = table->parts}, table->out);
    lg_free(table->context, sorted);
    return status;
}
