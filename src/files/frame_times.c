/* Times as texts: numbers of seconds, dates with a time (ISO 8601), and times of day. */
#include <math.h>

#include "core/text.h"
#include "files/frame.h"

#define SECOND INT64_C(1000000000)
#define DAY    (86400 * SECOND)

/* Reads numbers by a pattern: d is a digit, any other character separates two numbers. Returns their end, or
 * NULL. */
static const char *scan(const char *at, const char *pattern, int64_t *out) {
    for (*out = 0; *pattern != '\0'; pattern++, at++) {
        if (*pattern == 'd' ? *at < '0' || *at > '9' : *at != *pattern) return NULL;
        if (*pattern == 'd')
            *out = 10 * *out + (*at - '0');
        else
            *++out = 0;
    }
    return at;
}

static const char *scan_clock(const char *at, int64_t *out) {
    int64_t t[3];
    at = scan(at, at[0] != '\0' && at[1] == ':' ? "d:dd:dd" : "dd:dd:dd", t);
    if (at == NULL || t[0] > 23 || t[1] > 59 || t[2] > 59) return NULL;
    *out += ((t[0] * 60 + t[1]) * 60 + t[2]) * SECOND;
    if (*at != '.') return at;
    for (int64_t unit = SECOND / 10; *++at >= '0' && *at <= '9'; unit /= 10) *out += unit * (*at - '0');
    return at;
}

/* Days before a month, up to a constant. Years begin in March here, so that a leap day is the last one. */
static int64_t days_before(int64_t year, int64_t month) {
    const int64_t months = 12 * year + month - 3, y = months / 12;
    return 365 * y + y / 4 - y / 100 + y / 400 + (153 * (months % 12) + 2) / 5;
}

static const char *scan_offset(const char *at, int64_t *out) {
    const int64_t minute = *at == '-' ? 60 * SECOND : -60 * SECOND;
    int64_t hours, minutes = 0;
    if (*at == 'Z') return at + 1;
    at = scan(at + 1, "dd", &hours);
    if (at != NULL && (*at == ':' || (*at >= '0' && *at <= '9')))
        at = scan(at + (*at == ':'), "dd", &minutes);
    *out += minute * (60 * hours + minutes);
    return hours < 24 && minutes < 60 ? at : NULL;
}

/* The rest of a date: its time and its offset. */
static const char *scan_date(const char *at, const int64_t date[3], lg_moment *out) {
    /* 290 years of nanoseconds fit into 64 bits */
    if (date[0] < 1900 || date[0] > 2189 || date[1] < 1 || date[1] > 12 || date[2] < 1 ||
        date[2] > days_before(date[0], date[1] + 1) - days_before(date[0], date[1]) ||
        (*at != 'T' && *at != ' '))
        return NULL;
    out->nanoseconds = (days_before(date[0], date[1]) + date[2] - days_before(2000, 1)) * DAY;
    at = scan_clock(at + 1, &out->nanoseconds);
    if (at == NULL || (*at != 'Z' && *at != '+' && *at != '-')) return at;
    out->format = LG_TIME_OFFSET;
    return scan_offset(at, &out->nanoseconds);
}

const char *lg_moment_scan(const char *text, lg_moment *out) {
    int64_t date[3];
    const char *at = scan(text, "dddd-dd-dd", date);
    *out = (lg_moment){.format = at != NULL ? LG_TIME_DATE : LG_TIME_OF_DAY};
    at = at != NULL ? scan_date(at, date, out) : scan_clock(text, &out->nanoseconds);
    if (at != NULL || out->format != LG_TIME_OF_DAY) return at;
    out->format = LG_TIME_SECONDS;
    return lg_decimal(text, &out->seconds);
}

bool lg_moment_is_packed(double number) {
    int64_t n = number > 0.0 && number < 1e17 ? (int64_t)number : 0;
    if (n >= 10000000000000000) n /= 1000;      /* YYYYMMDDhhmmssfff */
    if (n >= 100000000000 && n < 1000000000000) /* YYYYMMDDhhmm, YYMMDDhhmmss */
        return (number == floor(number) && lg_moment_is_packed(100.0 * number)) ||
               lg_moment_is_packed(2e13 + number);
    const int64_t date = n / 1000000, month = date / 100 % 100, day = date % 100;
    return date >= 19000101 && date <= 21891231 && month >= 1 && month <= 12 && day >= 1 && day <= 31 &&
           n / 10000 % 100 < 24 && n / 100 % 100 < 60 && n % 100 < 60;
}

double lg_clock_read(lg_clock *clock, lg_moment now) {
    if (clock->format == LG_TIME_NONE) {
        clock->format = now.format;
        clock->first = clock->last = now.nanoseconds;
    }
    if (now.format != clock->format) return NAN;
    if (now.format == LG_TIME_SECONDS) return now.seconds;
    while (now.format == LG_TIME_OF_DAY && clock->last - now.nanoseconds > DAY / 2) now.nanoseconds += DAY;
    clock->last = now.nanoseconds;
    return (double)(now.nanoseconds - clock->first) / (double)SECOND;
}
