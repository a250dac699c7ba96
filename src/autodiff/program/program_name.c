/* Names of functions, ports and parameters. */
#include "autodiff/program/program_check.h"

#include <string.h>

/* Keywords and operators of C11 and C++20. */
static const char reserved[] =
    " alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t char32_t char8_t "
    "class co_await co_return co_yield compl concept const const_cast consteval constexpr constinit "
    "continue decltype default delete do double dynamic_cast else enum explicit export extern false float "
    "for friend goto if inline int long mutable namespace new noexcept not not_eq nullptr operator or or_eq "
    "private protected public register reinterpret_cast requires restrict return short signed sizeof static "
    "static_assert static_cast struct switch template this thread_local throw true try typedef typeid "
    "typename typeof union unsigned using virtual void volatile wchar_t while xor xor_eq ";

static bool is_reserved(const char *name) {
    const size_t length = strlen(name);
    for (const char *s = reserved; (s = strstr(s, name)) != NULL; s++)
        if (s[-1] == ' ' && s[length] == ' ') return true;
    return false;
}

static bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}

const char *lg_program_name_problem(const char *name) {
    if (name == NULL || name[0] == '\0') return "it is empty";
    if (!is_letter(name[0]) || name[0] == '_') return "it does not begin with a letter";
    size_t length = 0;
    for (; name[length] != '\0'; length++) {
        const char c = name[length];
        if (!is_letter(c) && !(c >= '0' && c <= '9')) return "it is not a C identifier";
        if (c == '_' && name[length + 1] == '_') return "it has two underscores in a row, which C++ reserves";
        if (length >= LG_PROGRAM_MAX_NAME) return "it is too long";
    }
    return is_reserved(name) ? "it is a reserved word of C or C++" : NULL;
}

const char *lg_shown_name(const char *name, char shown[LG_SHOWN_NAME]) {
    size_t n = 0;
    for (; name != NULL && name[n] != '\0' && n + 1 < LG_SHOWN_NAME; n++)
        shown[n] = name[n] >= ' ' && name[n] <= '~' ? name[n] : '?';
    shown[n] = '\0';
    return shown;
}

lg_status lg_program_check_name(const char *what, const char *name, lg_error *error) {
    const char *problem = lg_program_name_problem(name);
    char shown[LG_SHOWN_NAME];
    return problem == NULL ? LG_OK
                           : lg_fail(error, LG_INVALID_ARGUMENT, "'%s' cannot be the name of %s: %s",
                                     lg_shown_name(name, shown), what, problem);
}

const char *const lg_derivative_begins[LG_DERIVATIVE_KIND_COUNT] = {"fwd1_", "adj1_", "jac_", "jac_adj1_"};

bool lg_program_is_derivative(const char *name) {
    bool is = false;
    for (size_t i = 0; i < LG_DERIVATIVE_KIND_COUNT; i++)
        is = is || strncmp(name, lg_derivative_begins[i], strlen(lg_derivative_begins[i])) == 0;
    return is;
}
