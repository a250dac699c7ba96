/* Spaces as text: lg_space_text writes it, lg_space_read reads it. */
#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/integrators.h"

/* R^n has its dimension n behind `power`; other factors have their number of copies behind `copies`. */
static const char power[] = "R^", copies[] = " x ", next[] = ", ";

/* A factor takes at most 29 bytes: a name of 6, " x " and a count of 20. */
void lg_space_text(const lg_space *space, char text[LG_SPACE_TEXT]) {
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < space->factors; i++) {
        const lg_space_factor *factor = &space->factor[i];
        const bool flat = factor->kind == LG_SPACE_RN;
        const char *name = flat ? power : lg_space_kind_entry(factor->kind)->name;
        char count[24] = "";
        if (flat || factor->count > 1)
            (void)snprintf(count, sizeof count, "%s%zu", flat ? "" : copies, factor->count);
        used += (size_t)snprintf(text + used, LG_SPACE_TEXT - used, "%s%s%s", i > 0 ? next : "", name, count);
    }
}

/* Moves *at behind `word`. Returns false if the text at *at does not begin with `word`. */
static bool take(const char **at, const char *word) {
    const size_t length = strlen(word);
    if (strncmp(*at, word, length) != 0) return false;
    *at += length;
    return true;
}

/* Reads a whole number >= `least` without leading zeros. */
static bool take_count(const char **at, size_t least, size_t *out) {
    size_t value = 0;
    if (**at == '0') return false;
    for (; **at >= '0' && **at <= '9'; ++*at) {
        if (value > SIZE_MAX / 16) return false;
        value = 10 * value + (size_t)(**at - '0');
    }
    *out = value;
    return value >= least;
}

static bool take_factor(const char **at, lg_space_factor *out) {
    if (take(at, power)) {
        out->kind = LG_SPACE_RN;
        return take_count(at, 1, &out->count);
    }
    for (size_t kind = 0; kind < LG_SPACE_KINDS; kind++) {
        if (!take(at, lg_space_kind_entry((lg_space_kind)kind)->name)) continue;
        *out = (lg_space_factor){(lg_space_kind)kind, 1};
        return !take(at, copies) || take_count(at, 2, &out->count);
    }
    return false;
}

lg_status lg_space_read(const char *text, lg_space *out, lg_error *error) {
    LG_NEEDS(error, text, out);
    lg_space_factor factors[LG_SPACE_MAX_FACTORS];
    size_t count = 0;
    const char *at = text;
    do {
        const char *begin = at;
        if (count == LG_SPACE_MAX_FACTORS)
            return lg_fail(error, LG_FORMAT, "a space can have at most %d factors", LG_SPACE_MAX_FACTORS);
        if (!take_factor(&at, &factors[count++]) || (*at != '\0' && strncmp(at, next, strlen(next)) != 0))
            return lg_fail(
                error, LG_FORMAT,
                "expected a factor such as R^2, T*S^2 or SO(3) x 2, then ', ' or the end, found '%.40s'",
                begin);
    } while (take(&at, next));
    if (lg_space_init(out, factors, count) != LG_OK)
        return lg_fail(error, LG_FORMAT, "'%.40s' has more copies of a factor than a space can have", text);
    return LG_OK;
}
