/* Reads and writes labelled sets of series: /X (n, channels, length), /y, /group and /run (n). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/median.h"
#include "datasets/series_files.h"
#include "settings/files/attributes.h"

void lg_series_data_destroy(lg_series_data *data) {
    if (data == NULL) return;
    lg_series_destroy(&data->series);
    *data = (lg_series_data){.sha256 = ""};
}

static size_t samples_of(const lg_series *s) {
    return s->count * s->channels * s->length;
}

static void hash(lg_series_data *data) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add_floats(&state, data->series.x, samples_of(&data->series));
    lg_sha256_add_u32(&state, data->series.label, data->series.count);
    if (data->series.group != NULL) lg_sha256_add_u32(&state, data->series.group, data->series.count);
    if (data->series.run != NULL) lg_sha256_add_u32(&state, data->series.run, data->series.count);
    lg_sha256_finish(&state, data->sha256);
}

static lg_status check_samples(const char *path, const lg_series *s, lg_error *error) {
    const size_t window = (size_t)s->channels * s->length, count = samples_of(s);
    size_t at = 0;
    while (at < count && isfinite(s->x[at])) at++;
    if (at == count) return LG_OK;
    return lg_fail(error, LG_NOT_FINITE,
                   "%s: /X: %s in window %zu, channel %zu, sample %zu, counted from 0: leave this window out",
                   lg_shown_path(path), isnan(s->x[at]) ? "NaN" : "a value beyond single precision",
                   at / window, at % window / s->length, at % s->length);
}

/* Fails with LG_INVALID_ARGUMENT if the windows of some run are not consecutive. */
static lg_status check_runs(const lg_context *context, const char *path, const lg_series *s,
                            lg_error *error) {
    size_t stretches = 0;
    if (s->run == NULL) return LG_OK;
    LG_TRY_SCRATCH(uint32_t, sorted, context, s->count, lg_no_memory_for(path, error));
    for (size_t i = 0; i < s->count; i++)
        if (i == 0 || s->run[i] != s->run[i - 1]) sorted[stretches++] = s->run[i];
    qsort(sorted, stretches, sizeof *sorted, lg_compare_u32);
    for (size_t i = 1; i < stretches; i++)
        if (sorted[i] == sorted[i - 1])
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "%s: /run: the windows of run %u do not follow each other", lg_shown_path(path),
                           sorted[i]);
    return LG_OK;
}

/* ---- reading ---- */

typedef struct read_call {
    const lg_context *context;
    const char *path;
    const lg_series *like;
    lg_h5 *h5;
    lg_series_data *out;
    bool bad_rate; /* the attribute rate, written by another program, is not a number */
    lg_precision precision;
    bool ours;               /* the file was written by this library, so its attributes must be valid */
    lg_error torn;           /* of check_runs */
    bool by_number, guessed; /* as in lg_labels */
} read_call;

/* The shape of /X is (n, channels, length) or (n, length). */
static lg_status read_shape(read_call *call, lg_error *error) {
    lg_series *s = &call->out->series;
    lg_h5_about about;
    lg_h5_size windows = {0, "windows", NULL}, channels = {0, "channels", NULL},
               samples = {0, "samples", NULL};
    const lg_h5_array three = {"X", NULL, {&windows, &channels, &samples}, false},
                      two = {"X", NULL, {&windows, &samples}, false};
    LG_TRY(lg_as_format(lg_h5_look(call->h5, "X", sizeof *s->x, &about, error), error));
    LG_TRY(lg_h5_fit(call->h5, about.rank < 3 ? &two : &three, sizeof *s->x, false, &about, error));
    if (windows.n > UINT32_MAX || channels.n > UINT32_MAX || samples.n > UINT32_MAX)
        return lg_h5_fail(call->h5, error, "/X: more than %u windows, channels or samples: split it",
                          UINT32_MAX);
    s->count = (size_t)windows.n;
    s->channels = about.rank < 3 ? 1 : (uint32_t)channels.n;
    s->length = (uint32_t)samples.n;
    return LG_OK;
}

/* Reads the labels first, because they give the number of classes; then allocates the set. */
static lg_status read_labels(read_call *call, lg_error *error) {
    lg_series *s = &call->out->series;
    LG_CLEAN(lg_labels_destroy) lg_labels labels = {.context = call->context};
    LG_CLEAN(lg_names_destroy) lg_names names = {.context = call->context};
    LG_TRY(lg_labels_read(call->h5, "y", s->count, &labels, error));
    LG_TRY(lg_labels_classes(call->h5, call->ours, call->like, &labels, &names, error));
    s->classes = names.count;
    if (lg_series_allocate(call->context, s, lg_h5_has(call->h5, "group"), lg_h5_has(call->h5, "run")) !=
        LG_OK)
        return lg_no_memory_for(call->path, error);
    memcpy(s->class_name, names.name, names.count * sizeof *names.name);
    for (size_t i = 0; i < s->count; i++) s->label[i] = labels.class_of[labels.label[i]];
    if (labels.of_class.count > 0) s->class_label = lg_names_take(&labels.of_class);
    call->by_number = labels.by_number;
    call->guessed = labels.guessed;
    return LG_OK;
}

/* Reads /group or /run. Numbers stay as they are; texts become 0, 1, ... in ascending order of the texts. */
static lg_status read_units(read_call *call, const char *name, uint32_t *out, lg_error *error) {
    const lg_series *s = &call->out->series;
    if (out == NULL) return LG_OK;
    LG_CLEAN(lg_labels_destroy) lg_labels units = {.context = call->context};
    LG_TRY(lg_labels_read(call->h5, name, s->count, &units, error));
    if (units.value != NULL)
        return lg_h5_narrow(call->h5, name, units.value, s->count, UINT32_MAX, out, error);
    memcpy(out, units.label, s->count * sizeof *out);
    return LG_OK;
}

/* ---- attributes ---- */

static const lg_field about[] = {LG_FIELD(lg_series_data, "", "noise", REAL, noise, LG_ANY_REAL),
                                 LG_FIELD(lg_series_data, "", "severity", REAL, severity, LG_ANY_REAL),
                                 LG_FIELD(lg_series_data, "", "housing", TEXT, housing, .low = 0),
                                 LG_FIELD_END};

/* With `like` the class may be one that `like` does not have; then it is unknown. */
static lg_status read_healthy(read_call *call, lg_error *error) {
    const lg_series *s = &call->out->series;
    char *healthy = call->out->healthy, names[160] = "";
    if (!lg_h5_has_attribute(call->h5, "", "healthy")) return LG_OK;
    const lg_status status = lg_h5_text(call->h5, "", "healthy", healthy, LG_SERIES_NAME, NULL);
    const uint32_t at = status == LG_OK && healthy[0] != '\0' ? lg_series_healthy(s, healthy) : LG_NO_CLASS;
    if (at != LG_NO_CLASS || (status == LG_OK && call->like != NULL)) {
        (void)snprintf(healthy, LG_SERIES_NAME, "%s", at != LG_NO_CLASS ? s->class_name[at] : "");
        return LG_OK;
    }
    lg_names_show(s->class_name, s->classes, names, sizeof names);
    return lg_h5_fail(call->h5, error, "attribute healthy: expected the name of one of the classes, %s",
                      names);
}

/* A number that is unknown is NaN. If another program wrote the file, so is an attribute that is not a
 * number. */
static lg_status read_attributes(read_call *call, lg_error *error) {
    lg_series *s = &call->out->series;
    LG_TRY(lg_names_list(call->h5, "channels", false, &s->channels, &s->channel_name, error));
    lg_status status = lg_rate_get(call->h5, s, call->ours ? error : NULL);
    if (status != LG_OK && call->ours) return status;
    call->bad_rate = status != LG_OK;
    if (call->bad_rate) s->rate = 0;
    LG_TRY(read_healthy(call, error));
    for (const lg_field *row = about; row->name != NULL; row++) {
        const double unknown = NAN;
        const bool there = lg_h5_has_attribute(call->h5, "", row->name);
        status = there ? lg_field_get(call->h5, row, call->out, call->ours ? error : NULL) : LG_NOT_FOUND;
        if (there && call->ours) LG_TRY(status);
        if (status != LG_OK && row->type == LG_FIELD_REAL)
            memcpy((char *)call->out + row->offset, &unknown, sizeof unknown);
    }
    return LG_OK;
}

static lg_status read_checked(void *user, lg_h5 *h5, lg_error *error) {
    read_call *call = user;
    lg_series *s = &call->out->series;
    call->h5 = h5;
    LG_TRY(lg_h5_check_format(h5, "series", true, error));
    call->ours = lg_h5_is_ours(h5);
    LG_TRY(read_shape(call, error));
    LG_TRY(read_labels(call, error));
    LG_TRY(read_units(call, "group", s->group, error));
    LG_TRY(read_units(call, "run", s->run, error));
    const lg_status torn = check_runs(call->context, call->path, s, &call->torn);
    if (torn == LG_OUT_OF_MEMORY) return lg_no_memory_for(call->path, error);
    if (torn != LG_OK) { /* runs whose windows are not consecutive are left out */
        lg_free(call->context, s->run);
        s->run = NULL;
    }
    LG_TRY(read_attributes(call, error));
    LG_TRY(lg_as_format(lg_series_convert(h5, s, &call->precision, error), error));
    LG_TRY(check_samples(call->path, s, error));
    LG_TRY(lg_precision_check(call->path, &call->precision, error));
    lg_h5_provenance(h5, &call->out->provenance);
    return LG_OK;
}

static void warn(const read_call *call) {
    const char *shown = lg_shown_path(call->path);
    if (call->torn.status != LG_OK)
        lg_log_message(call->context, LG_LOG_WARNING, "%s: runs are treated as unknown", call->torn.message);
    if (call->by_number)
        lg_log_message(call->context, LG_LOG_WARNING,
                       "%s: /y: the labels are not names of the expected classes and are taken as their "
                       "numbers: 0 is '%s'",
                       shown, call->out->series.class_name[0]);
    if (call->bad_rate)
        lg_log_message(
            call->context, LG_LOG_WARNING,
            "%s: attribute rate is not a number of samples per second: the rate is treated as unknown",
            shown);
    lg_precision_warn(call->context, call->path, &call->precision);
    if (call->guessed)
        lg_log_message(call->context, LG_LOG_WARNING,
                       "%s: /y: neither 0 nor the number of classes occurs: labels are taken as numbers from "
                       "0 on; attribute class_labels, such as '1|2|3', can say which label is which class",
                       shown);
}

lg_status lg_series_read(const lg_context *context, const char *path, const lg_read_options *options,
                         const lg_series *like, lg_series_data *out, lg_error *error) {
    LG_NEEDS(error, path, out);
    if (like != NULL && (like->classes < 1 || like->class_name == NULL))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: the series that gives the expected classes has no classes", lg_shown_path(path));
    LG_CLEAN(lg_series_data_destroy) lg_series_data made = {.series = {.context = context}};
    read_call call = {.context = context, .path = path, .like = like, .out = &made};
    LG_TRY(lg_h5_read(context, path, options, read_checked, &call, error));
    warn(&call);
    hash(&made);
    return LG_GIVE(out, made);
}

/* ---- writing ---- */

static lg_status check_written(const lg_context *context, const char *path, const lg_series_data *data,
                               lg_error *error) {
    const lg_series *s = &data->series;
    if (isinf(data->noise) || isinf(data->severity))
        return lg_fail(error, LG_NOT_FINITE, "%s: noise or severity is infinite", lg_shown_path(path));
    if (memchr(data->housing, '\0', sizeof data->housing) == NULL ||
        memchr(data->healthy, '\0', sizeof data->healthy) == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: the text housing or healthy does not end with a zero byte", lg_shown_path(path));
    if (data->healthy[0] != '\0' && lg_series_healthy(s, data->healthy) == LG_NO_CLASS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: healthy: '%s' is none of the classes",
                       lg_shown_path(path), data->healthy);
    LG_TRY(lg_sensing_check(context, path, s, error));
    for (size_t i = 0; i < s->count; i++)
        if (s->label[i] >= s->classes)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "%s: /y: class %u at index (%zu), but there are only %u classes",
                           lg_shown_path(path), s->label[i], i, s->classes);
    LG_TRY(check_runs(context, path, s, error));
    return check_samples(path, s, error);
}

static lg_status put_all(lg_h5 *h5, const lg_series_data *data, lg_error *error) {
    const lg_series *s = &data->series;
    const uint64_t dims[3] = {s->count, s->channels, s->length};
    lg_series names = *s;
    names.class_label = NULL; /* the /y that is written holds class numbers 0, 1, ... */
    LG_TRY(lg_h5_put_header(h5, "series", &data->provenance, error));
    LG_TRY(lg_sensing_put(h5, &names, error));
    for (const lg_field *row = about; row->name != NULL; row++)
        if (row->type == LG_FIELD_REAL ? !isnan(lg_field_number(row, data)) : data->housing[0] != '\0')
            LG_TRY(lg_field_write(h5, row, data, error));
    if (data->healthy[0] != '\0') /* the class by its name, because class_label is not written */
        LG_TRY(lg_h5_put_text(h5, "", "healthy", s->class_name[lg_series_healthy(s, data->healthy)], error));
    LG_TRY(lg_h5_put_text(h5, "", "data_sha256", data->sha256, error));
    LG_TRY(lg_h5_put(h5, "X", LG_ELEMENT_F32, 3, dims, s->x, error));
    LG_TRY(lg_h5_put(h5, "y", LG_ELEMENT_U32, 1, dims, s->label, error));
    if (s->group != NULL) LG_TRY(lg_h5_put(h5, "group", LG_ELEMENT_U32, 1, dims, s->group, error));
    return s->run != NULL ? lg_h5_put(h5, "run", LG_ELEMENT_U32, 1, dims, s->run, error) : LG_OK;
}

lg_status lg_series_write(const lg_context *context, const char *path, lg_series_data *data,
                          lg_error *error) {
    if (path == NULL || data == NULL || data->series.x == NULL || data->series.label == NULL ||
        data->series.count < 1 || data->series.count > UINT32_MAX || data->series.channels < 1 ||
        data->series.length < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the file's name, the samples or the labels are NULL, or there are no samples");
    lg_h5 *h5;
    LG_TRY(check_written(context, path, data, error));
    LG_TRY(lg_h5_create(context, path, &h5, error));
    hash(data);
    return lg_h5_finish(h5, put_all(h5, data, error), error);
}
