/* Measures on the target how many instructions a call takes and how much stack it needs. Build with
 * -DMODEL=name, -DMODEL_HEADER='"name.h"', and -DHAS_GRAD, -DHAS_FIELD, -DHAS_CURVE and -DHAS_CLASSIFY for
 * the functions that the header declares; -DHAS_CONTROL, -DHAS_OBSERVE and -DHAS_ADAPT for a controller.
 *
 * Under `qemu-system-arm -icount shift=0` each instruction takes one nanosecond of machine time, and SysTick
 * counts this time at 25 MHz. So the number of instructions is 40 times the ticks, rounded to a multiple of
 * 40. This is not a number of cycles: a Cortex-M4 needs one to three cycles for most instructions, and 14 for
 * a division or square root in float. On a board, SysTick at the core's clock counts cycles.
 */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include MODEL_HEADER

#define JOIN_(a, b) a##_##b
#define JOIN(a, b)  JOIN_(a, b)
#define OF(what)    JOIN(MODEL, what)

enum { CALLS = 10, INSTRUCTIONS_A_TICK = 40 };

static OF(real) x[OF(INPUTS)], y[OF(OUTPUTS)], work[OF(WORK_SIZE)];
#ifdef HAS_GRAD
static OF(real) jacobian[OF(OUTPUTS) * OF(INPUTS)];
#endif

static volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010; /* control, reload, current */
extern uint32_t stack_bottom[];                                            /* from the linker script */

/* The counter runs freely, has 24 bits and counts downwards. */
static uint32_t ticks(void) {
    return systick[2];
}

/* Fills the stack below the caller's frame with a pattern. Where a call has overwritten the pattern, it has
 * used the stack. Inlined, so that it has no frame of its own. */
#define PATTERN 0xA5C35A3Cu
__attribute__((always_inline)) static inline const uint32_t *paint(void) {
    uint32_t *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    for (volatile uint32_t *at = stack_bottom; at < top; at++) *at = PATTERN;
    return top;
}

static unsigned painted_over(const uint32_t *top) {
    const uint32_t *at = stack_bottom;
    while (at < top && *at == PATTERN) at++;
    return (unsigned)((const char *)top - (const char *)at);
}

#define COUNT(name, call)                                                                                    \
    do {                                                                                                     \
        const uint32_t *const top = paint();                                                                 \
        call;                                                                                                \
        const unsigned stack = painted_over(top);                                                            \
        const uint32_t begin = ticks();                                                                      \
        for (int n = 0; n < CALLS; n++) call;                                                                \
        const uint32_t used = (begin - ticks()) & 0xFFFFFFu;                                                 \
        printf("%-10s %10lu instructions %8u bytes of stack\n", name,                                        \
               (unsigned long)(used * (INSTRUCTIONS_A_TICK / CALLS)), stack);                                \
        most = stack > most ? stack : most;                                                                  \
    } while (0)

int main(void) {
    unsigned most = 0;
    systick[1] = 0xFFFFFFu;
    systick[2] = 0;
    systick[0] = 5; /* processor clock, no interrupt */
    for (int i = 0; i < OF(INPUTS); i++) x[i] = (OF(real))0.1 * (OF(real))(i % 7);
    x[0] = (OF(real))0.5;
#ifdef HAS_CONTROL
    COUNT("control", OF(control)(x, y, work));
#else
    COUNT("eval", OF(eval)(x, y, work));
#endif
#ifdef HAS_OBSERVE
    static OF(real) estimate[OF(INPUTS)], filter[OF(OBSERVE_SIZE)];
    OF(observe_start)(x, filter);
    COUNT("observe", OF(observe)(x, y, filter, estimate, work));
#endif
#ifdef HAS_ADAPT
    static OF(real) found[OF(FOUND)], least_squares[OF(ADAPT_SIZE)];
    OF(adapt_start)(least_squares);
    COUNT("adapt", OF(adapt)(x, y, x, least_squares, found, work));
#endif
#ifdef HAS_GRAD
    COUNT("grad", OF(grad)(x, y, jacobian, work));
#endif
#ifdef HAS_FIELD
    static OF(real) out[OF(INPUTS)];
    COUNT("field", OF(field)(x, NULL, out, work));
    COUNT("step", OF(step)((OF(real))0.001, x, NULL, out, work));
#endif
#ifdef HAS_CURVE
    static OF(real) boundary[8], q[2], v[2];
    const OF(real) s = (OF(real))0.5;
    boundary[0] = x[0];
    COUNT("curve", OF(curve)(boundary, &s, 1, q, v, work));
#endif
#ifdef HAS_CLASSIFY
    static OF(real) probability[OF(CLASSES)];
    COUNT("classify", (void)OF(classify)(x, probability, work));
#endif
    const unsigned stack_bound = OF(STACK_SIZE);
    printf("stated     %10u bytes of stack, %u bytes of work\n", stack_bound, (unsigned)sizeof work);
    if (most <= stack_bound) return 0;
    printf("FAILED: more stack than stated\n");
    return 1;
}
