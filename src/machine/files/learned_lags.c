/* What a fit says of the lags that it learned. */
#include <string.h>

#include "machine/files/choice.h"

static const char not_shown[] = "no lag that the log shows";
static const double least_rows = 0.2; /* scales.lag[0], in rows */

/* The learned lag of this input; NULL: none was learned. */
static const lg_identified *find(const lg_machine_verdict *what, const char *input) {
    static const char prefix[] = "lag.";
    const size_t length = strlen(prefix);
    for (size_t i = 0; i < what->count; i++) {
        const lg_identified *number = &what->identified.numbers[i];
        if (strncmp(number->name, prefix, length) == 0 && strcmp(number->name + length, input) == 0)
            return number;
    }
    return NULL;
}

/* The log shows no lag below its step, however small its stated error is. */
static bool is_shown(const lg_machine *machine, const lg_identified *lag) {
    return lag->value >= machine->scales.lag[0] / least_rows;
}

void lg_machine_warn_of_lags(const lg_training *self, const lg_machine_verdict *what) {
    static const double near_high = 0.95;
    const lg_machine *machine = &((const lg_machine_model_run *)self->run)->machine;
    const double *range = machine->scales.lag;
    for (uint32_t i = 0; i < machine->input_count; i++) {
        const lg_identified *lag = find(what, machine->inputs[i]);
        if (lag == NULL) continue;
        if (!is_shown(machine, lag))
            LG_WARN(self,
                    "%s: %s: %.3g s is below the step between two rows, %.3g s; take `lag: none` for %s",
                    lag->name, not_shown, lag->value, range[0] / least_rows, machine->inputs[i]);
        if (lag->value > near_high * range[1])
            LG_WARN(self,
                    "%s: %.3g s is the longest lag that these logs can show: they have no part that is "
                    "longer than five such times",
                    lag->name, lag->value);
    }
}

/* The time constant of an input in seconds, learned or known; 0: it has no lag. */
static double lag_of(const lg_machine *machine, const lg_machine_verdict *what, uint32_t input) {
    const lg_identified *learned = find(what, machine->inputs[input]);
    for (uint32_t i = 0; i < machine->term_count && learned == NULL; i++)
        for (uint32_t k = 0; k < machine->terms[i].of_count && machine->terms[i].kind->order > 0; k++)
            if (machine->terms[i].of[k].index == input) return machine->terms[i].values[k];
    return learned != NULL ? learned->value : 0.0;
}

/* Writes the losses from each start of the scan, which is named by its seconds. */
static lg_status tell_ratios(lg_training *self, lg_error *error) {
    enum { ROOM = 24 };
    const lg_machine_state *s = self->state;
    const double row = ((const lg_machine_model_run *)self->run)->machine.scales.lag[0] / least_rows;
    char *text;
    LG_TRAINING_ARRAY(self, text, ROOM * LG_LAG_STARTS, error);
    lg_result_open(self, "ratios", '{');
    for (size_t i = 0; i < LG_LAG_STARTS; i++, text += ROOM) {
        (void)lg_format(text, ROOM, "%.6g", lg_lag_starts[i] * row);
        if (s->lag_ratios[i] > 0) LG_TELL(self, LG_REAL(text, s->lag_ratios[i], NULL));
    }
    lg_result_close(self, '}');
    return LG_OK;
}

lg_status lg_machine_tell_lags(lg_training *self, const lg_machine_verdict *what, lg_error *error) {
    const lg_machine *machine = &((const lg_machine_model_run *)self->run)->machine;
    const uint32_t n = machine->input_count;
    bool learned = false, shown = true;
    for (uint32_t i = 0; i < n; i++) {
        const lg_identified *lag = find(what, machine->inputs[i]);
        learned = learned || lag != NULL;
        shown = shown && (lag == NULL || is_shown(machine, lag));
    }
    if (!learned) return LG_OK;
    lg_result_open(self, "lag", '{');
    if (n > 1) lg_result_open(self, "chosen", '[');
    for (uint32_t i = 0; i < n; i++)
        lg_result_add(self, LG_REAL(n > 1 ? NULL : "chosen", lag_of(machine, what, i), NULL));
    if (n > 1) lg_result_close(self, ']');
    LG_TRY(tell_ratios(self, error));
    if (!shown) LG_TELL(self, LG_TEXT("warning", not_shown, NULL));
    lg_result_close(self, '}');
    return LG_OK;
}
