#include "queue.h"

#include <string.h>

void publish_events(shared *f, engine *e)
{
    int k;

    for (k = 0; k < e->happenings; ++k) {
        event *place = &f->events[f->told % EVENTS];

        word_open(&place->sequence);
        e->happened[k].sequence = 0;
        *place = e->happened[k];
        word_set(&place->sequence, ++f->told);
        word_set(&f->status->events, f->told);
    }
    e->happenings = 0;
}

static whole slot_bits(const engine *e)
{
    whole bits = 0;
    int k;

    for (k = 0; k < SLOTS; ++k)
        bits |= (whole)(e->slots[k].running | e->slots[k].in_control << 1) << 2 * k;
    return bits;
}

static int is_frozen(const engine *e)
{
    return e->state == SAFE && e->trip > 0;
}

void publish_record(shared *f, const engine *e, const real *y, whole late_ns, whole step_ns)
{
    const whole sample = e->sample - 1;
    unsigned char *place = f->start + f->at.ring + sample % f->at.ring_count * f->at.stride;
    record_head *head = (record_head *)(void *)place;

    word_open(&head->sequence);
    head->state = e->state;
    head->trip = e->trip;
    head->slots = slot_bits(e);
    head->saturated = (whole)e->saturated;
    head->unhealthy = (whole)e->sensors.unhealthy;
    head->late_ns = late_ns;
    head->step_ns = step_ns;
    engine_record(e, y, (real *)(void *)(head + 1));
    word_set(&head->sequence, sample + 1);
    if (word_get(&f->asks->taken) <= sample - f->at.ring_count)
        ++f->status->lost;
    if (!f->status->frozen) {
        memcpy(f->start + f->at.pretrip + sample % f->at.pretrip_count * f->at.stride, place, (size_t)f->at.stride);
        f->status->frozen_at = sample + 1;
    }
}

void publish_status(shared *f, const engine *e)
{
    status *s = f->status;
    int k;

    s->state = e->state;
    s->trip = e->trip;
    s->trips = e->trips;
    s->hold_verified = e->hold_verified;
    memcpy(s->momentum, e->monitors.momentum, (size_t)e->set.outputs * sizeof *s->momentum);
    s->frozen = is_frozen(e);
    for (k = 0; k < SLOTS; ++k) {
        s->loaded[k] = e->slots[k].loaded;
        if (e->slots[k].loaded)
            memcpy(s->slot_hash[k], e->slots[k].p.hash, sizeof s->slot_hash[k]);
    }
    if (s->blacklisted != e->blacklisted) {
        memcpy(s->blacklist, e->blacklist, sizeof s->blacklist);
        word_set(&s->blacklisted, e->blacklisted);
    }
    word_set(&s->sample, e->sample);
}

void answer_command(shared *f, engine *e, const command *c, enum answer answer)
{
    acknowledgement *a = &f->acknowledgements[c->number % COMMANDS];

    publish_events(f, e);
    publish_status(f, e);
    word_open(&a->number);
    a->sample = e->sample;
    a->answer = answer;
    a->detail = c->kind;
    word_set(&a->number, c->number);
}

void acknowledge(shared *f, whole number)
{
    f->acknowledged = number;
    word_set(&f->status->acknowledged, number);
}
