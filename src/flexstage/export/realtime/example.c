/* fs_example.c: STAGE_NAME in a main loop.
 *
 *   cc -O2 -std=c99 -ffp-contract=off fs_example.c -o example -lm
 *   ./example               runs the self-test, then a loop of each drive in turn
 *   ./example - < FILE      reads one line of commands per step (COMMAND_NAMES)
 *
 * Prints time [s], commands and readings as CSV. Written by flexstage FLEXSTAGE_VERSION.
 */
#include <stdio.h>
#include <string.h>

#include "fs_.h"

static fs_stage stage;

static void print_row(long i, const fs_real *commands, const fs_real *readings)
{
    int j;
    printf("%.9g", (double)i * (double)FS_STEP);
    for (j = 0; j < FS_DRIVES; j++)
        printf(",%.9g", (double)commands[j]);
    for (j = 0; j < FS_PROBES; j++)
        printf(",%.9g", (double)readings[j]);
    printf("\n");
}

static int step(long i, const fs_real *commands)
{
    fs_real readings[FS_PROBES];
    const char *message = fs_step(&stage, commands, readings);
    if (message) {
        fprintf(stderr, "step %ld: %s\n", i, message);
        return 1;
    }
    print_row(i, commands, readings);
    return 0;
}

/* Commands from a file. */
static int follow(void)
{
    fs_real commands[FS_DRIVES];
    long i;
    for (i = 0;; i++) {
        int j;
        for (j = 0; j < FS_DRIVES; j++) {
            double value;
            const int got = scanf("%lf%*[ ,;\t]", &value);
            if (got == EOF && j == 0)
                return 0;
            if (got != 1) {
                fprintf(stderr, "line %ld: expected %d numbers\n", i + 1, FS_DRIVES);
                return 1;
            }
            commands[j] = (fs_real)value;
        }
        if (i == 0)
            fs_settle(&stage, commands);
        if (step(i, commands))
            return 1;
    }
}

/* Each drive in turn from its lowest command to its highest and back. */
static int loops(void)
{
    static const double low[] = {LOWEST}, high[] = {HIGHEST};
    const long samples = 500;
    fs_real commands[FS_DRIVES];
    long i;
    int j;
    for (j = 0; j < FS_DRIVES; j++)
        commands[j] = (fs_real)low[j];
    fs_settle(&stage, commands);
    for (i = 0; i < samples * FS_DRIVES; i++) {
        const double turn = 6.283185307179586 * (double)(i % samples) / (double)samples;
        j = (int)(i / samples);
        commands[j] = (fs_real)(low[j] + 0.5 * (high[j] - low[j]) * (1.0 - cos(turn)));
        if (step(i, commands))
            return 1;
    }
    return 0;
}

int main(int argc, char **argv)
{
    const double deviation = (double)fs_self_test(&stage);
    fprintf(stderr, "self-test: largest deviation %.3g of the range of a reading\n", deviation);
    if (!(deviation < SELF_TEST_LIMIT)) {
        fprintf(stderr, "this exceeds SELF_TEST_LIMIT: check the compiler options\n");
        return 1;
    }
    printf("CSV_HEAD\n");
    return argc > 1 && strcmp(argv[1], "-") == 0 ? follow() : loops();
}
