/* Flags of boxes that meet at a jump, and of results whose operands have lower flags.
 * ctest-labels: src/certify src/autodiff */
#include "exact_checks.h"

static void put(double *registers, size_t lane, const box *b) {
    for (size_t k = 0; k < OPERANDS; k++) {
        registers[k * 2 * IB + lane] = b->low[k];
        registers[k * 2 * IB + IB + lane] = b->high[k];
    }
}

/* Evaluates 32 boxes; every operand has all levels. */
static void evaluate(lg_interval_run *run, const instruction *f, const box *boxes, double *registers,
                     uint8_t *flags) {
    memset(flags, LG_INTERVAL_DIFFERENTIABLE, 3 * IB);
    for (size_t i = 0; i < IB; i++) put(registers, i, &boxes[i]);
    run(1, &f->code, registers, flags);
}

/* Two boxes that meet where an operation jumps or is not defined: at least one of them does not pass. */
TEST("of two boxes that meet at a jump, one has no continuity") {
    static const uint32_t ops[] = {LG_S_SIGN, LG_S_GE, LG_S_SELECT, LG_S_ATAN2, LG_S_DIV, LG_S_LOG};
    lg_rng r = test_rng(64, 2);
    lg_interval_run *run = lg_interval_kernel(lg_isa_in_use());
    double *registers = TEST_ARRAY(double, 8 * IB);
    uint8_t *flags = TEST_ARRAY(uint8_t, 4 * IB);
    for (size_t o = 0; o < LG_COUNT(ops); o++)
        for (int round = 0; round < 200; round++) {
            const instruction f = exact_instruction(&r, ops[o]);
            const size_t side = f.code.op == LG_S_DIV ? 1 : 0; /* the operand that crosses 0 */
            box boxes[IB] = {{{0}, {0}}};
            for (size_t i = 0; i < IB; i += 2) {
                const double wide = fabs(exact_number(&r)) + 5e-324;
                const double other = f.code.op == LG_S_GE ? 0 : f.code.op == LG_S_ATAN2 ? -1 : 2;
                for (size_t j = 0; j < OPERANDS; j++) boxes[i].low[j] = boxes[i].high[j] = j == 2 ? 5 : other;
                boxes[i + 1] = boxes[i];
                boxes[i].low[side] = -wide, boxes[i].high[side] = 0;
                boxes[i + 1].low[side] = 0, boxes[i + 1].high[side] = wide;
            }
            evaluate(run, &f, boxes, registers, flags);
            for (size_t i = 0; i < IB; i += 2)
                if (flags[3 * IB + i] >= LG_INTERVAL_CONTINUOUS &&
                    flags[3 * IB + i + 1] >= LG_INTERVAL_CONTINUOUS)
                    fail_msg("operation %u: both sides of 0 pass, up to %g", f.code.op,
                             boxes[i + 1].high[side]);
        }
}

TEST("a result has at most the levels of its operands, and operands that are not read do not matter") {
    lg_interval_run *run = lg_interval_kernel(lg_isa_in_use());
    lg_rng r = test_rng(64, 3);
    double *registers = TEST_ARRAY(double, 8 * IB);
    uint8_t *flags = TEST_ARRAY(uint8_t, 4 * IB);
    for (uint32_t op = LG_S_ADD; op < SQUARE; op++)
        for (int from = 0; from < OPERANDS; from++) {
            const instruction f = exact_instruction(&r, op);
            box boxes[IB];
            for (size_t i = 0; i < IB; i++) boxes[i] = (box){{2, 1, 3}, {2.5, 1.5, 4}};
            evaluate(run, &f, boxes, registers, flags);
            const uint8_t own = flags[3 * IB];
            for (size_t i = 0; i < IB; i++) flags[(size_t)from * IB + i] = i % 5;
            run(1, &f.code, registers, flags);
            for (size_t i = 0; i < IB; i++) {
                /* The condition of a choice matters only where it is undefined, what is not chosen never. */
                const bool reads = (uint32_t)from < f.operands && !(op == LG_S_SELECT && from == 2) &&
                                   !(op == LG_S_SELECT && from == 0 && i % 5 != 0);
                const uint8_t wanted = reads && i % 5 < own ? i % 5 : own;
                if (flags[3 * IB + i] != wanted)
                    fail_msg("operation %u: operand %d of level %zu gives %d, not %d", op, from, i % 5,
                             flags[3 * IB + i], wanted);
            }
        }
}
