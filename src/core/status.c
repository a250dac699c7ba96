#include "core/core.h"

const char *lg_status_name(lg_status status) {
    switch (status) {
#define X(code, value, sentence)                                                                             \
    case LG_##code:                                                                                          \
        return #code;
        LG_STATUS_LIST(X)
#undef X
    }
    return "UNKNOWN";
}

const char *lg_status_sentence(lg_status status) {
    switch (status) {
#define X(code, value, sentence)                                                                             \
    case LG_##code:                                                                                          \
        return sentence;
        LG_STATUS_LIST(X)
#undef X
    }
    return "unknown status";
}

lg_status lg_fail(lg_error *error, lg_status status, const char *format, ...) {
    if (error != NULL) {
        va_list arguments;
        va_start(arguments, format);
        error->status = status;
        (void)lg_format_list(error->message, sizeof error->message, format, arguments);
        va_end(arguments);
    }
    return status;
}

lg_status lg_check_rules(const lg_rule *rules, size_t count, lg_status status, lg_error *error) {
    for (size_t i = 0; i < count; i++)
        if (!rules[i].good) return lg_fail(error, status, "%s", rules[i].sentence);
    return LG_OK;
}
