#include "queue.h"

#include "checksum.h"

static whole size_asked(const command *c)
{
    return c->value[0] >= 0 && c->value[0] <= LARGEST_PACKAGE ? (whole)c->value[0] : -1;
}

/* Begin or finish a LOAD; 0 while it goes on. In lockstep time waits for it. */
static int load(queue *q, const shared *f, engine *e, const command *c, enum answer *answer)
{
    if (q->under_way) {
        if (!word_get(&q->load.done))
            return 0;
        q->under_way = 0;
        *answer = engine_loaded(e, (int)q->load.slot, q->load.found);
        return 1;
    }
    if (c->slot < 0 || c->slot >= SLOTS) {
        *answer = WRONG_SLOT;
        return 1;
    }
    if (e->slots[c->slot].running) {
        *answer = BUSY;
        return 1;
    }
    e->slots[c->slot].loaded = 0;
    if (f->set.clock == LOCKSTEP) {
        *answer = engine_loaded(e, (int)c->slot, load_package(f, e, c->slot, size_asked(c), c->value[1] != 0));
        return 1;
    }
    q->load.slot = c->slot;
    q->load.size = size_asked(c);
    q->load.with_proof = c->value[1] != 0;
    q->load.done = 0;
    q->under_way = 1;
    word_set(&q->load.wanted, 1);
    return 0;
}

/* A command of this number, if it is whole: its words may arrive in any order, its check comes out when all are there. */
static int read_command(const shared *f, whole number, command *c)
{
    *c = f->commands[number % COMMANDS];
    return c->number == number && (uint64_t)c->check == checksum(0xcbf29ce484222325u, c, sizeof *c / 8 - 1);
}

/* Not of one that commanded this engine before, or another one: what was recorded then moves nothing now. */
static int is_of_this_session(const shared *f, const command *c)
{
    return c->session == word_get(&f->asks->session);
}

static int was_early(const queue *q, whole number)
{
    return q->early[number % COMMANDS] == number;
}

/* Whether the next command in order may be carried out, or has been. */
static int head_is_due(const queue *q, const shared *f, const engine *e)
{
    const whole next = f->acknowledged + 1;
    command c;

    if (next > word_get(&f->asks->written))
        return 0;
    return was_early(q, next) || (read_command(f, next, &c) && (c.at <= e->sample || !is_of_this_session(f, &c)));
}

static int makes_safe(const command *c)
{
    return c->kind == DISENGAGE || c->kind == SILENCE || c->kind == END;
}

/* What would undo what a later command has made safe. */
static int is_withdrawn(const queue *q, const command *c)
{
    return (c->kind == ENGAGE && c->number < q->no_engage) || (c->kind == EXCITE && c->number < q->no_excite);
}

static void answer_early(queue *q, shared *f, engine *e, const command *c, enum answer answer)
{
    q->early[c->number % COMMANDS] = c->number;
    answer_command(f, e, c, answer);
}

/* Those before it that would undo it are withdrawn, also what has not arrived yet. The marks only rise: one sent before may be due after. */
static void withdraw_before(queue *q, shared *f, engine *e, const command *later)
{
    whole number;
    command c;

    if (later->kind != SILENCE && later->number > q->no_engage)
        q->no_engage = later->number;
    if (later->kind != DISENGAGE && later->number > q->no_excite)
        q->no_excite = later->number;
    for (number = f->acknowledged + 1; number < later->number; ++number)
        if (!was_early(q, number) && read_command(f, number, &c) && is_withdrawn(q, &c))
            answer_early(q, f, e, &c, WITHDRAWN);
}

/* What makes safe and is due, behind what is not: it does not wait for a package that is checked, or for a later time. */
static int find_early(const queue *q, const shared *f, const engine *e, command *c)
{
    const whole written = word_get(&f->asks->written), most = f->acknowledged + COMMANDS - 1;
    whole number;

    for (number = f->acknowledged + 1; number <= written && number <= most; ++number)
        if (!was_early(q, number) && read_command(f, number, c) && c->at <= e->sample && makes_safe(c)
            && is_of_this_session(f, c))
            return 1;
    return 0;
}

/* The answer to the next command in order; 0 while its package is checked. */
static int answer_head(queue *q, shared *f, engine *e, const command *c, enum answer *answer)
{
    if (c->kind == LOAD && (q->under_way || is_of_this_session(f, c)))
        return load(q, f, e, c, answer);
    if (!is_of_this_session(f, c))
        *answer = OTHER_SESSION;
    else if (c->kind != END)
        *answer = is_withdrawn(q, c) ? WITHDRAWN : engine_command(e, c);
    return 1;
}

int take_commands(queue *q, shared *f, engine *e)
{
    command c;

    while (head_is_due(q, f, e)) {
        enum answer answer = DONE;

        if (was_early(q, f->acknowledged + 1)) {
            acknowledge(f, f->acknowledged + 1);
            continue;
        }
        if (!read_command(f, f->acknowledged + 1, &c) || !answer_head(q, f, e, &c, &answer))
            break;
        answer_command(f, e, &c, answer);
        acknowledge(f, c.number);
        if (c.kind == END && answer == DONE)
            return 1;
    }
    while (find_early(q, f, e, &c)) {
        withdraw_before(q, f, e, &c);
        answer_early(q, f, e, &c, c.kind == END ? DONE : engine_command(e, &c));
        if (c.kind == END)
            return 1;
    }
    return 0;
}

int command_is_due(const queue *q, const shared *f, const engine *e)
{
    command c;

    return head_is_due(q, f, e) || find_early(q, f, e, &c);
}
