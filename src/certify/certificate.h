/* The operations of the scalar code in certificates. */
#ifndef LG_CERTIFICATE_H
#define LG_CERTIFICATE_H

/* X(name in files, operation of scalar code, number of operands that are lines, kind of the last number) */
#define LG_CERTIFICATE_OPS(X)                                                                                \
    X(in, INPUT, 0, WHOLE)                                                                                   \
    X(number, CONSTANT, 0, REAL)                                                                             \
    X(add, ADD, 2, NO)                                                                                       \
    X(sub, SUB, 2, NO)                                                                                       \
    X(mul, MUL, 2, NO)                                                                                       \
    X(div, DIV, 2, NO)                                                                                       \
    X(neg, NEG, 1, NO)                                                                                       \
    X(max, MAX, 2, NO)                                                                                       \
    X(ge, GE, 2, NO)                                                                                         \
    X(select, SELECT, 3, NO)                                                                                 \
    X(sqrt, SQRT, 1, NO)                                                                                     \
    X(abs, ABS, 1, NO)                                                                                       \
    X(sign, SIGN, 1, NO)                                                                                     \
    X(pow, POW, 1, REAL)                                                                                     \
    X(exp, EXP, 1, NO)                                                                                       \
    X(log, LOG, 1, NO)                                                                                       \
    X(sin, SIN, 1, NO)                                                                                       \
    X(cos, COS, 1, NO)                                                                                       \
    X(tanh, TANH, 1, NO)                                                                                     \
    X(sigmoid, SIGMOID, 1, NO)                                                                               \
    X(atan2, ATAN2, 2, NO)                                                                                   \
    X(stumpff, STUMPFF, 1, WHOLE)                                                                            \
    X(dexpinv, DEXPINV, 1, WHOLE)

typedef enum lg_certificate_last {
    LG_CERTIFICATE_NO,
    LG_CERTIFICATE_WHOLE,
    LG_CERTIFICATE_REAL
} lg_certificate_last;

enum { LG_CERTIFICATE_LINES = 1 << 16, LG_CERTIFICATE_BOXES = 1 << 20, LG_CERTIFICATE_STEPS = 1 << 12 };

#endif
