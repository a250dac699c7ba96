/* Cleans the logs' columns: normalises attitudes, makes angles continuous, brings velocities to the machine's
 * frames. */
#include <math.h>
#include <string.h>

#include "files/h5.h"
#include "machine/files/log_table.h"
#include "liegrad/geometry.h"

#define MOST_OFF    1e-2 /* a quaternion, direction or matrix that is off by more is refused */
#define NOTABLE_OFF 1e-3 /* an attitude that is off by more is warned of */
#define PI          3.14159265358979323846
#define TURN        (2 * PI)
#define DEGREE      0.0174533

typedef struct cleaning {
    lg_log_table *table;
    const lg_machine_coordinate *coordinate;
    const lg_log_coordinate *where;
    /* Of this coordinate: */
    size_t flips, mended, turns, guessed;
    double worst;         /* largest distance of an attitude from a valid one */
    double along, across; /* sums of squares: of omega along q, of omega */
} cleaning;

/* ---- attitudes ---- */

void lg_log_rotation(const double *q, uint32_t count, double R[9]) {
    if (count == 9) {
        memcpy(R, q, 9 * sizeof *R);
        return;
    }
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    R[0] = w * w + x * x - y * y - z * z, R[1] = 2 * (x * y - w * z), R[2] = 2 * (x * z + w * y);
    R[3] = 2 * (x * y + w * z), R[4] = w * w - x * x + y * y - z * z, R[5] = 2 * (y * z - w * x);
    R[6] = 2 * (x * z - w * y), R[7] = 2 * (y * z + w * x), R[8] = w * w - x * x - y * y + z * z;
}

static double determinant(const double R[9]) {
    double cross[3];
    lg_cross3(R, R + 3, cross);
    return lg_dot3(cross, R + 6);
}

/* Makes x the nearest rotation or unit vector; returns the distance to it. */
static double mend(double *x, uint32_t count, double length) {
    double was[9], squares = 0;
    memcpy(was, x, count * sizeof *x);
    if (count == 9) lg_so3_project(x);
    for (uint32_t i = 0; i < count; i++) {
        if (count < 9) x[i] = length > 0 ? x[i] / length : i == 0;
        squares += (was[i] - x[i]) * (was[i] - x[i]);
    }
    return sqrt(squares);
}

static lg_status mend_attitude(cleaning *c, size_t row, double *x) {
    const uint32_t count = c->where->attitudes;
    static const char *const whats[] = {[3] = "direction", [4] = "quaternion", [9] = "rotation matrix"};
    lg_name_list names;
    double squares = 0;
    for (uint32_t i = 0; i < count; i++) squares += x[i] * x[i];
    const double length = sqrt(squares);
    const bool reflection = count == 9 && determinant(x) < 0;
    const double off = reflection ? INFINITY : mend(x, count, length);
    if (off <= MOST_OFF) {
        c->mended += off > NOTABLE_OFF;
        if (off > c->worst) c->worst = off;
        return LG_OK;
    }
    lg_log_names_of(c->table, c->where->attitude, count, &names);
    if (reflection)
        return LG_LOG_FAIL(c->table, row,
                           "columns %s: the matrix has determinant -1, so it is a reflection, not a "
                           "rotation: is an axis reversed, or are two columns swapped?",
                           names.text);
    if (count == 9)
        return LG_LOG_FAIL(c->table, row,
                           "columns %s: not a rotation matrix: it differs from the nearest one by %.3g",
                           names.text, off);
    return LG_LOG_FAIL(c->table, row, "columns %s: not a %s: length %.6g instead of 1", names.text,
                       whats[count], length);
}

static lg_status clean_attitudes(cleaning *c, size_t part) {
    const lg_log_table *table = c->table;
    const uint32_t count = c->where->attitudes;
    const double *before = NULL;
    for (size_t row = table->first[part]; row < table->first[part + 1]; row++) {
        double *x = lg_log_row(table, row) + c->where->attitude, dot = 0;
        bool missing = false;
        for (uint32_t i = 0; i < count; i++) missing = missing || isnan(x[i]);
        for (uint32_t i = 0; i < count && missing; i++) x[i] = NAN;
        if (missing) continue;
        LG_TRY(mend_attitude(c, row, x));
        if (count != 4) continue;
        for (uint32_t i = 0; i < 4 && before != NULL; i++) dot += x[i] * before[i];
        for (uint32_t i = 0; i < 4 && dot < 0; i++) x[i] = -x[i];
        c->flips += dot < 0;
        before = x;
    }
    return LG_OK;
}

/* ---- velocities ---- */

static void clean_velocity(cleaning *c, double *values) {
    const lg_log_coordinate *where = c->where;
    double *v = values + where->velocity;
    const double *attitude = values + where->attitude;
    double R[9];
    if (c->coordinate->kind == LG_COORDINATE_DIRECTION) {
        const double along = lg_dot3(v, attitude);
        if (isfinite(along)) c->along += along * along, c->across += lg_dot3(v, v);
        for (int i = 0; i < 3 && isfinite(along); i++) v[i] -= along * attitude[i];
    } else if (where->space_frame) {
        lg_log_rotation(attitude, where->attitudes, R);
        lg_so3_coadjoint(R, v, v);
    }
}

/* ---- angles ---- */

/* Steps above pi of an angle between neighbouring rows. */
typedef struct steps {
    double largest;
    size_t at;  /* the row after the largest step */
    size_t odd; /* first row whose step is not near a multiple of 2 pi; 0: none */
} steps;

static steps look_at_steps(const cleaning *c) {
    const lg_log_table *table = c->table;
    const uint32_t column = c->where->place;
    steps s = {0, 0, 0};
    for (size_t part = 0; part < table->parts; part++) {
        for (size_t row = table->first[part] + 1; row < table->first[part + 1]; row++) {
            const double step = lg_log_row(table, row)[column] - lg_log_row(table, row - 1)[column];
            const double size = fabs(step);
            if (!(size > PI)) continue;
            if (size > s.largest) s.largest = size, s.at = row;
            if (s.odd == 0 && fabs(size - TURN * round(size / TURN)) > 1) s.odd = row;
        }
    }
    return s;
}

/* Across missing values, an angle goes on as its integrated velocity says. */
static void unwrap(cleaning *c, size_t part) {
    const lg_log_table *table = c->table;
    const bool measured = c->where->velocities > 0 && table->machine->measured == LG_MEASURED_VELOCITIES;
    double before = NAN, last = 0, way = 0, speed = 0;
    bool missing = false, blind = false; /* blind: a velocity is missing, too */
    for (size_t row = table->first[part]; row < table->first[part + 1]; row++) {
        double *values = lg_log_row(table, row), *x = values + c->where->place;
        const double was = speed, now = measured ? values[c->where->velocity] : (double)NAN;
        if (!isnan(now)) speed = now;
        if (row > table->first[part])
            way += 0.5 * (was + speed) * (lg_log_time(table, row) - lg_log_time(table, row - 1));
        if (isnan(*x)) {
            missing = true;
            blind = blind || isnan(now);
            continue;
        }
        const double turns = isnan(before) ? 0 : round((*x - before - (missing ? way : 0)) / TURN);
        c->turns += fabs(turns - last) > 0;
        c->guessed += missing && (blind || isnan(now)) && fabs(turns - last) > 0;
        last = turns;
        *x -= TURN * turns;
        before = *x;
        missing = blind = false;
        way = 0;
    }
}

/* Looks for angles in degrees. Must run before the first unwrapping: a wrapped angle stays within one
 * turn. */
static lg_status check_angle(cleaning *c) {
    lg_log_table *table = c->table;
    const uint32_t column = c->where->place;
    const lg_log_statistics *known = &table->out->columns[column];
    const char *name = table->machine->columns[column].name;
    const double range = known->high - known->low, scale = DEGREE * table->machine->columns[column].scale;
    const steps s = look_at_steps(c);
    if (range > 50 && s.largest > 300 && s.largest < 420)
        return LG_LOG_FAIL(
            table, s.at,
            "column %s: goes from %.6g to %.6g and jumps by %.6g: if it is in degrees, set scale: {%s: %.6g}",
            name, known->low, known->high, s.largest, name, scale);
    if (table->machine->unwrap && range > 1.1 * TURN && s.odd > 0)
        return LG_LOG_FAIL(
            table, s.odd,
            "column %s: changes by %.4g from one row to the next, which is not a turn of 2 pi: for degrees, "
            "set scale: {%s: %.6g}; for radians that are not wrapped, set unwrap: false",
            name, lg_log_row(table, s.odd)[column] - lg_log_row(table, s.odd - 1)[column], name, scale);
    if (range > 50)
        lg_log_warn(table,
                    "column %s: goes from %.6g to %.6g: these are many turns if they are radians; if "
                    "they are degrees, set scale: {%s: %.6g}",
                    name, known->low, known->high, name, scale);
    return LG_OK;
}

/* ---- whole table ---- */

static void tell(const cleaning *c) {
    lg_name_list names;
    lg_log_table *table = c->table;
    const lg_log_coordinate *where = c->where;
    lg_log_names_of(c->table, where->attitudes > 0 ? where->attitude : where->place,
                    where->attitudes > 0 ? where->attitudes : 1, &names);
    if (c->flips > 0)
        lg_log_warn(table, "columns %s: %zu changes of sign were undone: q and -q are the same rotation",
                    names.text, c->flips);
    if (c->mended > 0)
        lg_log_warn(table,
                    "columns %s: %zu rows were off by more than %g, at most by %.3g, and were corrected",
                    names.text, c->mended, NOTABLE_OFF, c->worst);
    if (c->turns > 0)
        lg_log_warn(table, "column %s: %zu jumps of 2 pi were undone: the angle is unwrapped", names.text,
                    c->turns);
    if (c->guessed > 0)
        lg_log_warn(
            table,
            "column %s: %zu of these jumps are across missing values, where no velocity counts turns: "
            "if the sensor counts them, set unwrap: false",
            names.text, c->guessed);
    const double part = c->across > 0 ? sqrt(c->along / c->across) : 0;
    lg_log_names_of(c->table, where->velocity, where->velocities, &names);
    if (part > NOTABLE_OFF)
        lg_log_warn(table,
                    "columns %s: a part of %.3g of the angular velocity is about the direction "
                    "itself, which this does not move: that part was removed",
                    names.text, part);
}

static lg_status clean_coordinate(cleaning *c) {
    const lg_log_table *table = c->table;
    const bool angle = c->coordinate->kind == LG_COORDINATE_ANGLE && c->where->places > 0;
    if (angle) LG_TRY(check_angle(c));
    for (size_t part = 0; part < table->parts; part++) {
        if (angle && table->machine->unwrap) unwrap(c, part);
        if (c->where->attitudes > 0) LG_TRY(clean_attitudes(c, part));
    }
    for (size_t row = 0; row < table->rows && c->where->velocities > 0; row++)
        clean_velocity(c, lg_log_row(table, row));
    tell(c);
    return LG_OK;
}

lg_status lg_log_clean(lg_log_table *table) {
    const lg_machine *m = &table->machine->machine;
    for (uint32_t i = 0; i < m->coordinate_count; i++)
        LG_TRY(clean_coordinate(&(cleaning){
            .table = table, .coordinate = &m->coordinates[i], .where = &table->machine->coordinates[i]}));
    return LG_OK;
}
