/* Converts fields from and to text and numbers. */
#include "liegrad/settings.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/tape.h"
#include "settings/settings.h"

_Static_assert(sizeof(lg_dtype) == sizeof(uint32_t) && sizeof(lg_activation) == sizeof(uint32_t) &&
                   sizeof(bool) == 1,
               "enumerations are read through their representation");

/* ---- names ---- */

void lg_field_option(const lg_field *row, char *text, size_t size) {
    (void)snprintf(text, size, "%s", row->option != NULL ? row->option : row->name);
    if (row->option != NULL) return;
    for (char *c = text; *c != '\0'; c++)
        if (*c == '_') *c = '-';
}

const lg_field *lg_field_find(const lg_field *rows, const char *name) {
    char option[64];
    for (; rows->name != NULL; rows++) {
        lg_field_option(rows, option, sizeof option);
        if (strcmp(rows->name, name) == 0 || strcmp(option, name) == 0) return rows;
    }
    return NULL;
}

/* ---- values ---- */

static const void *member_of(const lg_field *row, const void *run) {
    return (const char *)run + row->offset;
}

/* The value of a name, a flag or an integer member of any width, as an integer. Of a pointer member it is
 * the position of the entry that it points to in the field's list of values; if it points to none, their
 * number. */
static uint64_t whole_at(const lg_field *row, const void *run) {
    const void *at = member_of(row, run), *pointer;
    bool flag = false;
    uint32_t narrow = 0;
    if (row->value_at != NULL) {
        memcpy(&pointer, at, sizeof pointer);
        while (lg_field_name(row, narrow) != NULL && row->value_at(narrow) != pointer) narrow++;
        return narrow;
    }
    uint64_t wide = 0;
    memcpy(row->size == sizeof wide     ? (void *)&wide
           : row->size == sizeof narrow ? (void *)&narrow
                                        : &flag,
           at, row->size);
    return wide + narrow + flag;
}

static void set_whole(const lg_field *row, void *run, uint64_t value) {
    const bool flag = value != 0;
    const uint32_t narrow = (uint32_t)value;
    const void *const pointer = row->value_at != NULL ? row->value_at(narrow) : NULL;
    if (row->value_at != NULL) {
        memcpy((char *)run + row->offset, &pointer, sizeof pointer);
        return;
    }
    memcpy((char *)run + row->offset,
           row->size == sizeof value    ? (const void *)&value
           : row->size == sizeof narrow ? (const void *)&narrow
                                        : &flag,
           row->size);
}

static bool is_named(const lg_field *row) {
    return row->type == LG_FIELD_NAME || row->type == LG_FIELD_FLAG;
}

static bool is_whole(const lg_field *row) {
    return row->type == LG_FIELD_U64 || row->type == LG_FIELD_U32;
}

static bool is_list(const lg_field *row) {
    return row->type == LG_FIELD_WHOLES || row->type == LG_FIELD_REALS;
}

const char *lg_field_name(const lg_field *row, uint32_t value) {
    const bool beyond = row->value_count > 0 && value >= row->value_count;
    if (row->value_name != NULL) return beyond ? NULL : row->value_name(value);
    if (row->names == NULL) return NULL;
    const char *const *name = row->names;
    while (*name != NULL && value > 0) name++, value--;
    return *name;
}

/* Where the numbers of a list without `get` and `put` are, and their count: NULL if it is fixed. */
static char *list_at(const lg_field *row, const void *run, void **count) {
    char *base = (char *)(uintptr_t)run, *member = base + row->offset;
    *count = !row->array ? member : row->counted > 0 ? base + row->counted : NULL;
    if (row->array) return member;
    return member + (row->type == LG_FIELD_WHOLES ? offsetof(lg_wholes, values) : offsetof(lg_reals, values));
}

uint32_t lg_field_list(const lg_field *row, const void *run, double *values) {
    void *counted;
    if (!is_list(row)) return 0;
    if (row->get != NULL) return row->get(member_of(row, run), values);
    const char *at = list_at(row, run, &counted);
    uint32_t count = row->most;
    if (counted != NULL)
        count = row->array ? *(const uint32_t *)counted : (uint32_t) * (const size_t *)counted;
    if (row->array && count > row->most) count = row->most;
    for (uint32_t i = 0; i < count; i++)
        values[i] = row->type == LG_FIELD_WHOLES ? ((const uint32_t *)(const void *)at)[i]
                                                 : ((const double *)(const void *)at)[i];
    return count;
}

static void put_list(const lg_field *row, const double *values, uint32_t count, void *run) {
    void *counted;
    if (row->put != NULL) {
        row->put((char *)run + row->offset, values, count);
        return;
    }
    char *at = list_at(row, run, &counted);
    if (counted != NULL && row->array) *(uint32_t *)counted = count;
    if (counted != NULL && !row->array) *(size_t *)counted = count;
    for (uint32_t i = 0; i < count; i++)
        if (row->type == LG_FIELD_WHOLES)
            ((uint32_t *)(void *)at)[i] = (uint32_t)values[i];
        else
            ((double *)(void *)at)[i] = values[i];
}

uint64_t lg_field_whole(const lg_field *row, const void *run) {
    return is_named(row) || is_whole(row) || row->type == LG_FIELD_SWITCH ? whole_at(row, run) : 0;
}

double lg_field_number(const lg_field *row, const void *run) {
    double real;
    if (is_named(row) || is_whole(row)) return (double)whole_at(row, run);
    if (row->type != LG_FIELD_REAL) return (double)NAN;
    memcpy(&real, member_of(row, run), sizeof real);
    return real;
}

static bool in_range(const lg_field *row, double value) {
    return (row->above ? value > row->low : value >= row->low) && value <= row->high;
}

bool lg_field_fits(const lg_field *row, const void *run) {
    if (is_named(row)) return lg_field_name(row, (uint32_t)whole_at(row, run)) != NULL;
    if (row->type != LG_FIELD_REAL && !is_whole(row)) return true;
    return in_range(row, lg_field_number(row, run));
}

/* Writes the number with 15 digits if they give it exactly, else with 17. */
static void number_shown(double number, char out[32]) {
    (void)lg_format(out, 32, "%.15g", number);
    if (lg_real(out, NULL) != number) (void)lg_format(out, 32, "%.17g", number);
}

static void show_list(const lg_field *row, const void *run, char *text, size_t size) {
    double values[LG_FIELD_LIST_MAX];
    const uint32_t count = lg_field_list(row, run, values);
    char number[32];
    text[0] = '\0';
    for (uint32_t i = 0; i < count; i++) {
        number_shown(values[i], number);
        lg_append(text, size, "%s%s", i > 0 ? "," : "", number);
    }
}

void lg_field_show(const lg_field *row, const void *run, char *text, size_t size) {
    const char *name;
    char number[32];
    uint64_t whole;
    switch (row->type) {
    case LG_FIELD_REAL:
        number_shown(lg_field_number(row, run), number);
        (void)snprintf(text, size, "%s", number);
        break;
    case LG_FIELD_U64:
    case LG_FIELD_U32:
        whole = whole_at(row, run);
        name = (double)whole > row->high ? lg_field_name(row, (uint32_t)(whole - (uint64_t)row->high - 1))
                                         : NULL;
        if (name != NULL)
            (void)snprintf(text, size, "%s", name);
        else
            (void)snprintf(text, size, "%llu", (unsigned long long)whole);
        break;
    case LG_FIELD_FLAG:
    case LG_FIELD_NAME:
        name = lg_field_name(row, (uint32_t)whole_at(row, run));
        (void)snprintf(text, size, "%s", name != NULL ? name : "?");
        break;
    case LG_FIELD_WHOLES:
    case LG_FIELD_REALS:
        show_list(row, run, text, size);
        break;
    case LG_FIELD_SWITCH:
        (void)snprintf(text, size, "%s", whole_at(row, run) != 0 ? "true" : "false");
        break;
    case LG_FIELD_STRING:
        memcpy(&name, member_of(row, run), sizeof name);
        (void)snprintf(text, size, "%s", name != NULL ? name : "");
        break;
    case LG_FIELD_TEXT:
        (void)snprintf(text, size, "%s", (const char *)member_of(row, run));
        break;
    case LG_FIELD_SHOWN:
        row->show(run, text, size);
        break;
    case LG_FIELD_PHRASE:
        row->phrase(member_of(row, run), text, size);
        break;
    default:
        (void)snprintf(text, size, "?");
    }
}

void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run) {
    if (is_list(row))
        put_list(row, values, count, run);
    else if (row->type == LG_FIELD_REAL)
        memcpy((char *)run + row->offset, values, sizeof *values);
    else
        set_whole(row, run, (uint64_t)values[0]);
}

void lg_field_copy(const lg_field *row, const void *from, void *to) {
    double values[LG_FIELD_LIST_MAX];
    if (is_list(row))
        put_list(row, values, lg_field_list(row, from, values), to);
    else
        memcpy((char *)to + row->offset, member_of(row, from), row->size);
}

void lg_fields_default(const lg_field *rows, void *run) {
    for (; rows->name != NULL; rows++)
        if (rows->value != NULL) (void)lg_field_set(rows, rows->value, run, NULL);
}

/* ---- descriptions of what a field accepts ---- */

/* True if some number in `text` (a list or a single number) is above the upper bound. */
static bool exceeds(const lg_field *row, const char *text) {
    for (char *end;; text = end + 1) {
        const double value = lg_real(text, &end);
        if (value > row->high || (row->high == 0x1p64 && value >= row->high)) return true;
        if (end == text || *end != ',') return false;
    }
}

/* Describes the accepted range. Bounds so large that they mean "no bound" are named only if `text` exceeds
 * them. */
static void number_text(const lg_field *row, const char *text, char *out, size_t size) {
    const bool list = is_list(row), whole = row->type == LG_FIELD_WHOLES || is_whole(row);
    const bool low = row->low > -1e300, high = row->high < 0x1p63 || exceeds(row, text);
    char bound[32];
    (void)snprintf(out, size, "%s%s%s", list ? "a list of " : "a ", whole ? "whole number" : "number",
                   list ? "s" : "");
    number_shown(row->low, bound);
    if (low) lg_append(out, size, " %s %s", row->above ? "above" : "of at least", bound);
    number_shown(row->high, bound);
    if (high && row->high == 0x1p64)
        lg_append(out, size, " and below 2^64");
    else if (high)
        lg_append(out, size, " %s %s", low ? "and at most" : "of at most", bound);
    if (list) lg_append(out, size, ", separated by commas");
}

/* Lists the names of the values; "" without names. */
static void names_text(const lg_field *row, const char *last, char *out, size_t size) {
    const char *name;
    out[0] = '\0';
    for (uint32_t i = 0; (name = lg_field_name(row, i)) != NULL; i++)
        lg_append(out, size, "%s%s", i == 0 ? "" : lg_field_name(row, i + 1) == NULL ? last : ", ", name);
}

/* Formats the range as "1 to 1048576", "above 0 to 1" or "0 or more". */
static void span_text(const lg_field *row, char *text, size_t size) {
    char low[32], high[32] = "";
    number_shown(row->low, low);
    if (row->high < 0x1p63) (void)lg_format(high, sizeof high, row->high < 1e7 ? "%.15g" : "%g", row->high);
    (void)snprintf(text, size, "%s%s%s%s%s", is_list(row) ? "each " : "", row->above ? "above " : "", low,
                   high[0] != '\0' ? " to "
                   : row->above    ? ""
                                   : " or more",
                   high);
}

int lg_field_describe(const lg_field *row, char *text, size_t size) {
    char range[512] = "";
    const char *value = row->otherwise != NULL ? row->otherwise : row->value,
               *is = value != NULL ? "default " : "";
    if (value == NULL) value = "";
    if (row->group == NULL)
        return snprintf(text, size, value[0] != '\0' ? "%s (%s%s)" : "%s", row->meaning, is, value);
    names_text(row, " or ", range, sizeof range);
    if (is_named(row))
        return snprintf(text, size, "%s: %s%s%s%s%s", row->meaning, range, value[0] != '\0' ? " (" : "", is,
                        value, value[0] != '\0' ? ")" : "");
    /* The names of single values, if there are any, and a form: "adam or lm, or phases as in adam:100,lm". */
    if (row->form != NULL)
        lg_append(range, sizeof range, "%s%s", range[0] != '\0' ? ", or " : "", row->form);
    else
        span_text(row, range, sizeof range);
    return snprintf(text, size, "%s (%s%s%s%s)", row->meaning, range, value[0] != '\0' ? "; " : "", is,
                    value);
}

/* ---- from text ---- */

enum { SHOWN = 80 /* bytes of a wrong text that an error message shows */ };

static lg_status refuse_number(const lg_field *row, const char *text, lg_error *error) {
    char range[256], names[256];
    names_text(row, " or ", names, sizeof names);
    number_text(row, text, range, sizeof range);
    const bool named = names[0] != '\0';
    return lg_fail(error, LG_INVALID_ARGUMENT, "'%.*s%s' is %s%s%s%s", SHOWN, text,
                   strlen(text) > SHOWN ? "..." : "", named ? "neither " : "not ", names,
                   named ? " nor " : "", range);
}

/* The other spelling of a truth value; any other word as it is. */
static const char *respelled(const char *word) {
    return strcmp(word, "no") == 0 ? "false" : strcmp(word, "yes") == 0 ? "true" : word;
}

bool lg_field_find_name(const lg_field *row, const char *text, uint32_t *value) {
    const char *name;
    for (*value = 0; (name = lg_field_name(row, *value)) != NULL; (*value)++)
        if (strcmp(respelled(name), respelled(text)) == 0) return true;
    return false;
}

static lg_status set_name(const lg_field *row, const char *text, void *run, lg_error *error) {
    char names[512];
    uint32_t value;
    if (lg_field_find_name(row, text, &value)) {
        set_whole(row, run, value);
        return LG_OK;
    }
    names_text(row, ", ", names, sizeof names);
    return lg_fail(error, LG_INVALID_ARGUMENT, "'%.*s' is not one of %s", SHOWN, text, names);
}

static bool take_whole(const lg_field *row, const char *text, uint64_t *out) {
    return lg_integer_parse(text, out) == LG_OK && in_range(row, (double)*out);
}

static bool take_real(const lg_field *row, const char *text, double *out) {
    return lg_number_parse(text, out) == LG_OK && in_range(row, *out);
}

/* Reads one number of a list, which has `length` bytes. Integers must be below 2^53. */
static bool take_item(const lg_field *row, const char *text, size_t length, double *out) {
    char item[64];
    uint64_t whole = 0;
    if (length >= sizeof item) return false;
    memcpy(item, text, length);
    item[length] = '\0';
    if (row->type == LG_FIELD_REALS) return take_real(row, item, out);
    const bool good = take_whole(row, item, &whole);
    *out = (double)whole;
    return good;
}

static lg_status set_list(const lg_field *row, const char *text, void *run, lg_error *error) {
    double values[LG_FIELD_LIST_MAX];
    uint32_t items = 1;
    for (const char *c = text; *c != '\0'; c++) items += *c == ',';
    const uint32_t most = row->most > 0 ? row->most : LG_FIELD_LIST_MAX;
    if (items > most)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a list of %u numbers is too long; at most %u are allowed%s%s", items, most,
                       row->longer != NULL ? "; " : "", row->longer != NULL ? row->longer : "");
    if (items < row->least)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a list of %u numbers is too short; at least %u are needed", items, row->least);
    const char *at = text;
    for (uint32_t i = 0; i < items; i++) {
        const size_t length = strcspn(at, ",");
        if (!take_item(row, at, length, &values[i])) return refuse_number(row, text, error);
        at += length + 1;
    }
    put_list(row, values, items, run);
    return LG_OK;
}

static lg_status set_text(const lg_field *row, const char *text, void *run, lg_error *error) {
    const bool borrowed = row->type == LG_FIELD_STRING;
    if (text[0] == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "the value is empty");
    if (!borrowed && strlen(text) >= row->size)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the text is longer than %zu bytes", row->size - 1);
    memcpy((char *)run + row->offset, borrowed ? (const void *)&text : text,
           borrowed ? sizeof text : strlen(text) + 1);
    return LG_OK;
}

lg_status lg_field_set(const lg_field *row, const char *text, void *run, lg_error *error) {
    LG_NEEDS(error, row, run);
    double real;
    uint64_t whole;
    uint32_t word;
    if (row->type == LG_FIELD_SWITCH) {
        set_whole(row, run, true);
        return LG_OK;
    }
    LG_NEEDS(error, text);
    if (is_named(row)) return set_name(row, text, run, error);
    if (is_list(row)) return set_list(row, text, run, error);
    if (row->type == LG_FIELD_REAL) {
        if (!take_real(row, text, &real)) return refuse_number(row, text, error);
        memcpy((char *)run + row->offset, &real, sizeof real);
        return LG_OK;
    }
    if (row->type == LG_FIELD_STRING || row->type == LG_FIELD_TEXT) return set_text(row, text, run, error);
    if (row->type == LG_FIELD_PHRASE) return row->parse(text, (char *)run + row->offset, error);
    if (!is_whole(row)) return lg_fail(error, LG_INVALID_ARGUMENT, "%s cannot be set", row->name);
    if (lg_field_find_name(row, text, &word))
        whole = (uint64_t)row->high + 1 + word;
    else if (!take_whole(row, text, &whole))
        return refuse_number(row, text, error);
    set_whole(row, run, whole);
    return LG_OK;
}
