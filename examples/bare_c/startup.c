/* The code that runs before main on a Cortex-M without an operating system. It sets up the vector table, the
 * floating-point unit, memory and the stack, and needs no vendor library. Files and the exit code go through
 * semihosting (newlib's rdimon), which means to the debugger or emulator. */
#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

/* Symbols of the linker script. */
extern uint32_t stack_bottom[], stack_top[], data_load[], data_start[], data_end[], bss_start[], bss_end[];
extern char heap_start[], heap_end[];
extern int main(void);
extern void initialise_monitor_handles(void);
void _init(void);
void _fini(void);
void *_sbrk(ptrdiff_t bytes);
void reset(void);
static void fault(void);

/* newlib calls these functions. They are empty because there are no constructors. */
void _init(void) {
}
void _fini(void) {
}

/* newlib's _sbrk assumes that the heap ends at the stack, but here the stack is below the heap. */
void *_sbrk(ptrdiff_t bytes) {
    static char *top = heap_start;
    char *const before = top;
    if (bytes > heap_end - top || bytes < heap_start - top) {
        errno = ENOMEM;
        return (void *)-1;
    }
    top += bytes;
    return before;
}

typedef union vector {
    uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    {.stack = stack_top}, {.handler = reset}, {.handler = fault}, /* NMI */
    {.handler = fault},   {.handler = fault}, {.handler = fault}, /* hard fault, memory management, bus */
    {.handler = fault},                                           /* usage */
};

/* The stack is at the bottom of RAM. On many boards an access below RAM faults anyway. To make it fault on
 * all boards, the MPU forbids access to the 16 MB below the stack, more than one frame can skip. All other
 * memory keeps the default map. */
static void guard_stack(void) {
    volatile uint32_t *const mpu = (volatile uint32_t *)0xE000ED90; /* type, control, number, base, size */
    enum { GUARD_BITS = 24 };
    if ((mpu[0] >> 8 & 0xFFu) == 0) return; /* this MPU has no regions */
    mpu[2] = 0;
    mpu[3] = (uint32_t)stack_bottom - (1u << GUARD_BITS);
    mpu[4] = 1u << 28 | (GUARD_BITS - 1) << 1 | 1u; /* no access, no execution; enabled */
    mpu[1] = 5; /* MPU on; default map elsewhere; MPU off in fault handlers */
    __asm__ volatile("dsb\n isb");
}

void reset(void) {
    volatile uint32_t *const cpacr = (volatile uint32_t *)0xE000ED88;
    *cpacr |= 0xFu << 20; /* coprocessors 10 and 11: the floating-point unit */
    __asm__ volatile("dsb\n isb");
    guard_stack();
    for (uint32_t *to = data_start, *from = data_load; to < data_end;) *to++ = *from++;
    for (uint32_t *to = bss_start; to < bss_end;) *to++ = 0;
    initialise_monitor_handles();
    exit(main());
}

/* A fault ends the emulation with an exit code that no test returns. After a stack overflow no stack is left
 * for a handler, so the handler switches to a stack of its own. It never returns. */
enum { FAULT_CODE = 99, FAULT_STACK = 2048 };
static uint64_t fault_stack[FAULT_STACK / sizeof(uint64_t)];

__attribute__((used, noreturn)) static void stop(void) {
    _Exit(FAULT_CODE);
}

__attribute__((naked)) static void fault(void) {
    __asm__ volatile("mov sp, %0\n b %1" : : "r"(fault_stack + FAULT_STACK / sizeof(uint64_t)), "i"(stop));
}
