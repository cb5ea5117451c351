/* An article in another process, over UDP on this machine's loopback interface.

   Sample k asks with (check, k, alive, session, outputs since sample k - 1) and is answered by (check, k, session, rig, stale, sensors).
   The session is the one in which this engine was started: what belongs to another one is counted, in ``stale`` by the rig, and
   moves nothing. The rig is a number of chance of its own: the first one that answers is heard until this engine ends, answers of
   another one are counted too. The check is that of the words behind it, begun with FORMAT 2^32 + ASKED or ANSWERED: what was changed
   on the way is as good as lost. A request that was lost is sent again; the rig answers one that it has answered before in the same
   way, and moves by as many samples as k has grown. A rig of another FORMAT answers with (check, its FORMAT), of which the check
   begins with REFUSED_FORMAT whatever that is. */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "checksum.h"
#include "rig.h"

enum { TRIES = 20, OTHERS = 64, LOST_MS = 1 }; /* OTHERS: datagrams that are no answer, after which a try is over */

typedef struct {
    uint64_t check;
    whole sample, alive, session;
    real numbers[CHANNELS];
} request;

typedef struct {
    uint64_t check;
    whole sample, session, rig, stale;
    real numbers[CHANNELS];
} reply;

typedef struct {
    rig face;
    int socket;
    int lost; /* what did not answer in time is not waited for again in every sample */
    whole heard; /* the rig that answered first; 0: none yet */
    whole dropped, *stale; /* replies of other sessions and rigs; these, and what the rig has dropped */
    request out;
    size_t out_size, in_size;
} udp_rig;

static int be_patient(const udp_rig *r, whole ms)
{
    const struct timeval patience = {ms / 1000, (suseconds_t)(ms % 1000 * 1000)};

    return setsockopt(r->socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) == 0;
}

static enum rig_answer found(udp_rig *r, int lost)
{
    if (lost != r->lost)
        be_patient(r, lost ? LOST_MS : r->face.set->answer_ms / TRIES + 1);
    r->lost = lost;
    return lost ? RIG_LOST : RIG_READ;
}

/* Of all words of a datagram but the first, which is the check itself. FORMAT is in it: a rig of another one does not answer. */
static uint64_t check_of(uint64_t start, const void *datagram, size_t size)
{
    const size_t word = sizeof(uint64_t);

    return checksum((uint64_t)FORMAT << 32 | start, (const unsigned char *)datagram + word, size / word - 1);
}

static void send_request(udp_rig *r)
{
    r->out.check = check_of(ASKED, &r->out, r->out_size);
    if (send(r->socket, &r->out, r->out_size, MSG_DONTWAIT) < 0)
        return; /* as if it had been lost on the way */
}

static int is_answer(udp_rig *r, const reply *in, ssize_t got)
{
    if (got != (ssize_t)r->in_size || in->check != check_of(ANSWERED, in, r->in_size))
        return 0;
    if (!r->heard && in->session == r->out.session)
        r->heard = in->rig;
    if (in->session != r->out.session || in->rig != r->heard) {
        ++r->dropped;
        ++*r->stale; /* as long as the rig itself says nothing */
        return 0;
    }
    *r->stale = r->dropped + in->stale;
    return in->sample == r->out.sample;
}

/* A refusal; or what a rig from before there were checks answers: the request's first word, taken for a sample, and sensors. */
static int is_foreign(const udp_rig *r, const reply *in, ssize_t got)
{
    const ssize_t word = sizeof in->check;

    if (got == 2 * word && in->check == checksum(REFUSED_FORMAT, &in->sample, 1))
        return in->sample != FORMAT;
    if (got == (ssize_t)r->out_size && in->sample == r->out.sample)
        return 0; /* an echo of the request */
    return got == (ssize_t)r->in_size - 4 * word && in->check == r->out.check;
}

static enum rig_answer read_udp(rig *face, real *y)
{
    udp_rig *r = (udp_rig *)face;
    const int waits = face->set->clock == LOCKSTEP;
    int tries, others;
    reply in;

    for (tries = r->lost ? 1 : TRIES; tries > 0; --tries) {
        for (others = OTHERS; others > 0; --others) {
            const ssize_t got = recv(r->socket, &in, sizeof in, waits ? 0 : MSG_DONTWAIT);

            if (is_answer(r, &in, got)) {
                memcpy(y, in.numbers, (size_t)face->set->inputs * sizeof *y);
                return found(r, 0);
            }
            if (is_foreign(r, &in, got)) {
                found(r, 1);
                return RIG_FOREIGN;
            }
            if (got < 0)
                break;
        }
        if (waits || tries == TRIES)
            send_request(r);
    }
    return waits ? found(r, 1) : RIG_MISSED;
}

static enum rig_answer write_udp(rig *face, const real *u, whole alive)
{
    udp_rig *r = (udp_rig *)face;

    memcpy(r->out.numbers, u, (size_t)face->set->outputs * sizeof *u);
    r->out.alive = alive;
    ++r->out.sample;
    send_request(r);
    return RIG_READ;
}

static void close_udp(rig *face)
{
    udp_rig *r = (udp_rig *)face;

    r->out.sample = -1; /* the end */
    send_request(r);
    close(r->socket);
}

rig *open_udp_rig(const settings *set, whole session, whole *stale)
{
    static udp_rig r;
    struct sockaddr_in there;

    memset(&r, 0, sizeof r);
    memset(&there, 0, sizeof there);
    r.face.read = read_udp;
    r.face.write = write_udp;
    r.face.close = close_udp;
    r.face.set = set;
    r.stale = stale;
    r.out.session = session;
    r.out_size = sizeof r.out - sizeof r.out.numbers + (size_t)set->outputs * sizeof(real);
    r.in_size = sizeof(reply) - sizeof r.out.numbers + (size_t)set->inputs * sizeof(real);
    there.sin_family = AF_INET;
    there.sin_port = htons((uint16_t)set->port);
    there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    r.socket = socket(AF_INET, SOCK_DGRAM, 0);
    if (r.socket < 0 || connect(r.socket, (struct sockaddr *)&there, sizeof there) != 0
        || !be_patient(&r, set->answer_ms / TRIES + 1)) {
        perror("the rig's socket");
        return NULL;
    }
    send_request(&r);
    return &r.face;
}
