/* Start of a Cortex-M without a library: replay the test vectors, count the instructions of a step, report, stop.
 *
 * Reports by semihosting. The system timer counts 25 MHz of emulated time, in which the emulator gives each
 * instruction 64 ns (-icount shift=6): 1.6 ticks an instruction.
 */
#include "law.h"

#define REPEATS 64u
#define TIMER_CONTROL (*(volatile unsigned *)0xE000E010u)
#define TIMER_RELOAD (*(volatile unsigned *)0xE000E014u)
#define TIMER_VALUE (*(volatile unsigned *)0xE000E018u)
#define COPROCESSORS (*(volatile unsigned *)0xE000ED88u)

extern unsigned stack_top, data_load, data_start, data_end, bss_start, bss_end;

/* Which a compiler may call even where there is no library. */
void *memcpy(void *to, const void *from, unsigned count);
void *memset(void *to, int value, unsigned count);

void *memcpy(void *to, const void *from, unsigned count)
{
    volatile unsigned char *t = to;
    const unsigned char *f = from;

    while (count--)
        *t++ = *f++;
    return to;
}

void *memset(void *to, int value, unsigned count)
{
    volatile unsigned char *t = to;

    while (count--)
        *t++ = (unsigned char)value;
    return to;
}

static unsigned semihost(unsigned operation, const void *argument)
{
    register unsigned r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;

    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void report(const char *name, unsigned value)
{
    char digits[12];
    int i = 11;

    digits[i] = 0;
    do {
        digits[--i] = (char)('0' + value % 10);
        value /= 10;
    } while (value);
    semihost(4, name);
    semihost(4, &digits[i]);
    semihost(4, "\n");
}

static unsigned count_steps(unsigned steps, law_state *s, law_real *y, law_real *u)
{
    unsigned before, i;

    TIMER_VALUE = 0;
    before = TIMER_VALUE;
    for (i = 0; i < steps; ++i)
        law_step(s, y, u);
    return (before - TIMER_VALUE) & 0xFFFFFFu;
}

static law_state state;

static void run(void)
{
    law_real y[LAW_INPUTS], u[LAW_OUTPUTS];
    unsigned empty, full, stop[2] = {0x20026u, 0};
    int i;

    report("first difference ", (unsigned)law_replay());
    for (i = 0; i < LAW_INPUTS; ++i)
        y[i] = (law_real)(i + 1) / 4096;
    law_reset(&state);
    TIMER_RELOAD = 0xFFFFFFu;
    TIMER_CONTROL = 5;
    empty = count_steps(0, &state, y, u);
    full = count_steps(REPEATS, &state, y, u);
    report("instructions ", (unsigned)(((full - empty) * 5ul) / (8ul * REPEATS)));
    report("state bytes ", (unsigned)sizeof(law_state));
    semihost(0x18, (const void *)stop[0]);
    for (;;)
        ;
}

void reset(void)
{
    unsigned *to, *from = &data_load;

    COPROCESSORS |= 0xFu << 20;
    __asm__ volatile("dsb\n isb");
    for (to = &data_start; to < &data_end;)
        *to++ = *from++;
    for (to = &bss_start; to < &bss_end;)
        *to++ = 0;
    run();
}

static void fault(void)
{
    semihost(4, "fault\n");
    semihost(0x18, (const void *)0x20023u);
    for (;;)
        ;
}

static const struct {
    void *stack;
    void (*handlers[6])(void);
} vectors __attribute__((section(".vectors"), used)) = {&stack_top, {reset, fault, fault, fault, fault, fault}};
