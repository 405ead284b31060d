/* The work of a cycle, compiled: the same results, to the bit, as the numpy code beside each call of it.

   pack         a map of fixed keys as msgpack
   receiver     the buffers of a socket; receive: what waits in it, by the hundred; drain: into one block, with both
                clocks; merge: the blocks of several sockets into one, in the order of time
   slots        the slot of each frame
   assembly     the state of a CycleAssembler; feed and advance: the cycles that frames and time close, as records
   sorter       the assemblies of all feet; take: a block of frames into them; expected: what they wait for
   reader       the constants of a foot; read: counts into valid taxels, pressure and the sums of the wrench
   messages     a reader and the templates of its messages; read_record and pack_record: a record into messages
   inverse      the stages that invert a foot's effects, with their memory; invert: one cycle through them
   pads_on_rail, may_be_loose: whether a triangle may just have come loose
   activate     the activation of each taxel, and its sum over each board
   compare      each taxel with its neighbours, for dead and stuck ones
   press        the highest pressure of each region of the sole, and its integral

   Every array is passed as a buffer, and its length is checked here. It is built by hatch_build.py where there is a
   compiler, and is never required: each caller has its numpy code beside it. */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#define _GNU_SOURCE
#include <Python.h>
#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>

#define INTERFACE 5 /* another number for other functions or arguments; compiled.py has it too */
#define TAXELS 12
#define MOST_TRIANGLES 224
#define NEVER (-((int64_t)1 << 62))

/* --- buffers ------------------------------------------------------------------------------------------------- */

/* The contiguous memory of `object`, `size` bytes of it or, where size < 0, any number; -1 with an error set. */
static int contiguous(PyObject *object, Py_buffer *view, Py_ssize_t size, int writable)
{
    if (PyObject_GetBuffer(object, view, writable ? PyBUF_CONTIG : PyBUF_CONTIG_RO) < 0)
        return -1;
    if (size >= 0 && view->len != size) {
        PyErr_Format(PyExc_ValueError, "expected a buffer of %zd bytes, found %zd", size, view->len);
        PyBuffer_Release(view);
        return -1;
    }
    return 0;
}

/* `rows` rows of `width` contiguous bytes each, with any distance between them. */
static int rows_of(PyObject *object, Py_buffer *view, Py_ssize_t rows, Py_ssize_t width)
{
    if (PyObject_GetBuffer(object, view, PyBUF_STRIDED_RO) < 0)
        return -1;
    Py_ssize_t row_bytes = view->itemsize;
    int packed = view->ndim == 1;
    if (view->ndim == 2) {
        row_bytes *= view->shape[1];
        packed = view->strides[1] == view->itemsize;
    }
    if (!packed || view->shape[0] != rows || row_bytes != width) {
        PyErr_Format(PyExc_ValueError, "expected %zd rows of %zd bytes", rows, width);
        PyBuffer_Release(view);
        return -1;
    }
    return 0;
}

static void release(Py_buffer *views, int n)
{
    while (n--)
        PyBuffer_Release(&views[n]);
}

static int counted(Py_ssize_t found, Py_ssize_t expected)
{
    if (found == expected)
        return 0;
    PyErr_Format(PyExc_TypeError, "expected %zd arguments, found %zd", expected, found);
    return -1;
}

/* The number of `items`; -1 with an error unless there are `n_arrays` arrays and at most `most` items. */
static Py_ssize_t number_of_items(PyObject *arrays, int n_arrays, PyObject *items, int most, const char *name)
{
    Py_ssize_t n_items = PyTuple_Size(items);
    if (PyTuple_Size(arrays) == n_arrays && n_items >= 0 && n_items <= most)
        return n_items;
    if (!PyErr_Occurred())
        PyErr_Format(PyExc_ValueError, "expected %d arrays and at most %d %s", n_arrays, most, name);
    return -1;
}

/* --- pack ---------------------------------------------------------------------------------------------------- */

#define MOST_FIELDS 64

typedef struct {
    char *at, *end;
} Writer;

static int put(Writer *out, const void *bytes, Py_ssize_t n)
{
    if (out->end - out->at < n) {
        PyErr_SetString(PyExc_SystemError, "a packed value is longer than reckoned");
        return -1;
    }
    memcpy(out->at, bytes, (size_t)n);
    out->at += n;
    return 0;
}

/* A type byte and `n` bytes of `value`, the highest first. */
static int put_number(Writer *out, int type, uint64_t value, int n)
{
    unsigned char bytes[9] = {(unsigned char)type};
    for (int i = 0; i < n; i++)
        bytes[1 + i] = (unsigned char)(value >> (8 * (n - 1 - i)));
    return put(out, bytes, 1 + n);
}

static int put_unsigned(Writer *out, uint64_t value)
{
    if (value < 0x80)
        return put_number(out, (int)value, 0, 0);
    if (value <= 0xFF)
        return put_number(out, 0xCC, value, 1);
    if (value <= 0xFFFF)
        return put_number(out, 0xCD, value, 2);
    return value <= 0xFFFFFFFF ? put_number(out, 0xCE, value, 4) : put_number(out, 0xCF, value, 8);
}

static int put_signed(Writer *out, int64_t value)
{
    if (value >= 0)
        return put_unsigned(out, (uint64_t)value);
    if (value >= -32)
        return put_number(out, (int)(0x100 + value), 0, 0);
    if (value >= INT8_MIN)
        return put_number(out, 0xD0, (uint64_t)value, 1);
    if (value >= INT16_MIN)
        return put_number(out, 0xD1, (uint64_t)value, 2);
    return value >= INT32_MIN ? put_number(out, 0xD2, (uint64_t)value, 4) : put_number(out, 0xD3, (uint64_t)value, 8);
}

static int put_integer(Writer *out, PyObject *number)
{
    int beyond;
    long long value = PyLong_AsLongLongAndOverflow(number, &beyond);
    if (beyond) {
        unsigned long long large = PyLong_AsUnsignedLongLong(number);
        return PyErr_Occurred() ? -1 : put_unsigned(out, large);
    }
    if (value == -1 && PyErr_Occurred())
        return -1;
    return put_signed(out, value);
}

static int put_float(Writer *out, double value)
{
    uint64_t bits;
    if (!isfinite(value))
        return put_number(out, 0xC0, 0, 0);
    memcpy(&bits, &value, 8);
    return put_number(out, 0xCB, bits, 8);
}

static int put_long(Writer *out, const void *bytes, Py_ssize_t n, int type)
{
    int header = n <= 0xFF ? put_number(out, type, (uint64_t)n, 1)
               : n <= 0xFFFF ? put_number(out, type + 1, (uint64_t)n, 2)
                             : put_number(out, type + 2, (uint64_t)n, 4);
    return header < 0 ? -1 : put(out, bytes, n);
}

/* pack(heads, values): heads[i] is what stands before values[i], ready made: its key, before the first the map's head.
   Values are None, bool, int, float (null where not finite), str or arrays. */
static PyObject *pack(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[MOST_FIELDS];
    int n_views = 0;
    char *start = NULL;
    if (counted(n_arguments, 2) < 0)
        return NULL;
    PyObject *heads = arguments[0], *values = arguments[1], *packed = NULL;
    Py_ssize_t n = PyTuple_Size(values);
    if (n < 0 || n > MOST_FIELDS || PyTuple_Size(heads) != n) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_ValueError, "expected as many heads as values, 64 at the most");
        return NULL;
    }
    Py_ssize_t size = 0;
    for (Py_ssize_t i = 0; i < n; i++) {
        PyObject *value = PyTuple_GetItem(values, i);
        Py_ssize_t head = PyBytes_Size(PyTuple_GetItem(heads, i)), length = 4;
        if (head < 0)
            goto end;
        if (PyUnicode_Check(value)) {
            if (PyUnicode_AsUTF8AndSize(value, &length) == NULL)
                goto end;
        } else if (value != Py_None && !PyFloat_Check(value) && !PyLong_Check(value)) {
            if (contiguous(value, &views[n_views], -1, 0) < 0) {
                PyErr_Clear();
                PyObject *copy = PyObject_CallMethod(value, "tobytes", NULL);
                int failed = copy == NULL || contiguous(copy, &views[n_views], -1, 0) < 0;
                Py_XDECREF(copy); /* the buffer keeps it */
                if (failed)
                    goto end;
            }
            length = views[n_views++].len;
        }
        size += head + 5 + length;
    }
    start = PyMem_Malloc((size_t)size + 1);
    if (start == NULL) {
        PyErr_NoMemory();
        goto end;
    }
    Writer out = {start, start + size};
    int view = 0;
    for (Py_ssize_t i = 0; i < n; i++) {
        PyObject *head = PyTuple_GetItem(heads, i), *value = PyTuple_GetItem(values, i);
        int failed = put(&out, PyBytes_AsString(head), PyBytes_Size(head));
        if (failed == 0) {
            if (value == Py_None)
                failed = put_number(&out, 0xC0, 0, 0);
            else if (PyBool_Check(value))
                failed = put_number(&out, value == Py_True ? 0xC3 : 0xC2, 0, 0);
            else if (PyFloat_Check(value))
                failed = put_float(&out, PyFloat_AsDouble(value));
            else if (PyLong_Check(value))
                failed = put_integer(&out, value);
            else if (PyUnicode_Check(value)) {
                Py_ssize_t length;
                const char *text = PyUnicode_AsUTF8AndSize(value, &length);
                failed = length < 32 ? put_number(&out, 0xA0 | (int)length, 0, 0) || put(&out, text, length)
                                     : put_long(&out, text, length, 0xD9);
            } else {
                failed = put_long(&out, views[view].buf, views[view].len, 0xC4);
                view++;
            }
        }
        if (failed)
            goto end;
    }
    packed = PyBytes_FromStringAndSize(start, out.at - start);
end:
    PyMem_Free(start);
    release(views, n_views);
    return packed;
}

/* --- drain --------------------------------------------------------------------------------------------------- */

#define STAMP_HEADER ((int64_t)1 | (int64_t)35 << 32) /* cmsg_level SOL_SOCKET, cmsg_type SCM_TIMESTAMPNS */
#define STAMP_BYTES 32
#define CONTROL_BYTES 64

/* A block of n frames: t_ns, t_mono_ns (8 bytes each), struct can_frame (16), interface (1), one array after another. */
#define FRAME_BYTES 33

typedef struct {
    Py_ssize_t n;
    int64_t *t_ns, *t_mono_ns;
    char *raw;
    unsigned char *interface;
} Block;

static Block block_of(char *bytes, Py_ssize_t n)
{
    Block block = {n, (int64_t *)bytes, (int64_t *)bytes + n, bytes + 16 * n, (unsigned char *)bytes + 32 * n};
    return block;
}

/* The block in a bytes object; n < 0 with an error set where it is none. */
static Block block_in(PyObject *object)
{
    Block none = {-1, NULL, NULL, NULL, NULL};
    Py_ssize_t size = PyBytes_Size(object);
    if (size < 0)
        return none;
    if (size % FRAME_BYTES) {
        PyErr_Format(PyExc_ValueError, "expected %d bytes of each frame, found %zd bytes", FRAME_BYTES, size);
        return none;
    }
    return block_of(PyBytes_AsString(object), size / FRAME_BYTES);
}

enum { FRAMES, CONTROL, HEADERS, N_RECEIVER };

typedef struct {
    Py_buffer views[N_RECEIVER];
    Py_ssize_t capacity;
} Receiver;

static void free_receiver(PyObject *capsule)
{
    Receiver *receiver = PyCapsule_GetPointer(capsule, "receiver");
    release(receiver->views, N_RECEIVER);
    PyMem_Free(receiver);
}

/* receiver(frames, control, headers): struct can_frame, control messages and struct mmsghdr that point to them, as many
   of each; written to from then on. */
static PyObject *make_receiver(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[N_RECEIVER] = {16, CONTROL_BYTES, sizeof(struct mmsghdr)};
    int held = 0;
    if (counted(n_arguments, N_RECEIVER) < 0)
        return NULL;
    Receiver *receiver = PyMem_Malloc(sizeof *receiver);
    if (receiver == NULL)
        return PyErr_NoMemory();
    receiver->capacity = 0;
    for (; held < N_RECEIVER; held++) {
        Py_ssize_t size = held ? sizes[held] * receiver->capacity : -1;
        if (contiguous(arguments[held], &receiver->views[held], size, 1) < 0)
            goto failed;
        if (held == FRAMES)
            receiver->capacity = receiver->views[FRAMES].len / 16;
    }
    PyObject *capsule = PyCapsule_New(receiver, "receiver", free_receiver);
    if (capsule != NULL)
        return capsule;
failed:
    release(receiver->views, held);
    PyMem_Free(receiver);
    return NULL;
}

/* receive(receiver, fd, held): recvmmsg into the headers that are not held yet, without blocking; how many frames are
   held then, or minus the error number. */
static PyObject *receive(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 3) < 0)
        return NULL;
    Receiver *receiver = PyCapsule_GetPointer(arguments[0], "receiver");
    if (receiver == NULL)
        return NULL;
    long fd = PyLong_AsLong(arguments[1]), held = PyLong_AsLong(arguments[2]);
    if (PyErr_Occurred())
        return NULL;
    long room = (long)receiver->capacity - held;
    if (held >= 0 && room > 0) {
        struct mmsghdr *headers = (struct mmsghdr *)receiver->views[HEADERS].buf + held;
        int taken = recvmmsg((int)fd, headers, (unsigned)room, MSG_DONTWAIT, NULL);
        held = taken >= 0 ? held + taken : errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? held : -errno;
    }
    return PyLong_FromLong(held);
}

/* drain(receiver, held, offset_ns, last_mono_ns, now_mono_ns): the first `held` frames. Returns (their block, how many
   have a time stamp, how many are standard data frames of 8 bytes, the kernel's count of lost frames or None, the last
   monotonic time). */
static PyObject *drain(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 5) < 0)
        return NULL;
    Receiver *receiver = PyCapsule_GetPointer(arguments[0], "receiver");
    if (receiver == NULL)
        return NULL;
    Py_ssize_t n = PyLong_AsSsize_t(arguments[1]);
    int64_t offset_ns = PyLong_AsLongLong(arguments[2]), last_ns = PyLong_AsLongLong(arguments[3]),
            now_ns = PyLong_AsLongLong(arguments[4]);
    if (PyErr_Occurred())
        return NULL;
    if (n < 1 || n > receiver->capacity) {
        PyErr_SetString(PyExc_ValueError, "expected as many frames as there is room for, one at least");
        return NULL;
    }
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, FRAME_BYTES * n);
    if (bytes == NULL)
        return NULL;
    Block block = block_of(PyBytes_AsString(bytes), n);
    const int64_t *control = receiver->views[CONTROL].buf;
    struct mmsghdr *headers = receiver->views[HEADERS].buf;
    memcpy(block.raw, receiver->views[FRAMES].buf, (size_t)(16 * n));
    memset(block.interface, 0, (size_t)n);
    PyObject *lost = NULL;
    if (headers[n - 1].msg_hdr.msg_controllen > STAMP_BYTES) {
        uint32_t count;
        memcpy(&count, (const char *)(control + (n - 1) * (CONTROL_BYTES / 8)) + STAMP_BYTES + 16, 4);
        lost = PyLong_FromUnsignedLong(count);
    } else
        lost = Py_NewRef(Py_None);
    long stamped = 0, plain = 0;
    for (Py_ssize_t i = 0; i < n; i++) {
        const int64_t *stamp = control + i * (CONTROL_BYTES / 8);
        uint64_t head;
        memcpy(&head, block.raw + 16 * i, 8);
        plain += head >> 11 == ((uint64_t)8 << 32) >> 11;
        stamped += stamp[1] == STAMP_HEADER;
        block.t_ns[i] = stamp[2] * 1000000000 + stamp[3];
        if (block.t_ns[i] + offset_ns > last_ns)
            last_ns = block.t_ns[i] + offset_ns;
        block.t_mono_ns[i] = last_ns < now_ns ? last_ns : now_ns;
        headers[i].msg_hdr.msg_controllen = CONTROL_BYTES;
    }
    return Py_BuildValue("NllNL", bytes, stamped, plain, lost, (long long)block.t_mono_ns[n - 1]);
}

#define MOST_BLOCKS 256 /* an interface is a byte */

/* merge(blocks): the frames of all blocks in a tuple as one block, in the order of monotonic time, frames of one time in
   the order of the blocks; the interface of each is its block's place in the tuple. */
static PyObject *merge(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Block blocks[MOST_BLOCKS];
    Py_ssize_t next[MOST_BLOCKS] = {0}, n = 0;
    if (counted(n_arguments, 1) < 0)
        return NULL;
    Py_ssize_t n_blocks = PyTuple_Size(arguments[0]);
    if (n_blocks < 0 || n_blocks > MOST_BLOCKS) {
        if (!PyErr_Occurred())
            PyErr_Format(PyExc_ValueError, "expected at most %d blocks", MOST_BLOCKS);
        return NULL;
    }
    for (Py_ssize_t k = 0; k < n_blocks; k++) {
        blocks[k] = block_in(PyTuple_GetItem(arguments[0], k));
        if (blocks[k].n < 0)
            return NULL;
        n += blocks[k].n;
    }
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, FRAME_BYTES * n);
    if (bytes == NULL)
        return NULL;
    Block merged = block_of(PyBytes_AsString(bytes), n);
    for (Py_ssize_t i = 0; i < n; i++) {
        Py_ssize_t first = -1;
        for (Py_ssize_t k = 0; k < n_blocks; k++)
            if (next[k] < blocks[k].n
                && (first < 0 || blocks[k].t_mono_ns[next[k]] < blocks[first].t_mono_ns[next[first]]))
                first = k;
        Py_ssize_t row = next[first]++;
        merged.t_ns[i] = blocks[first].t_ns[row];
        merged.t_mono_ns[i] = blocks[first].t_mono_ns[row];
        memcpy(merged.raw + 16 * i, blocks[first].raw + 16 * row, 16);
        merged.interface[i] = (unsigned char)first;
    }
    return bytes;
}

/* --- slots --------------------------------------------------------------------------------------------------- */

/* slots(table, codes, can_id, dlc, flags, data, out): as Streams.slots; how many frames carry no half, or -1 where one
   is no standard data frame of 8 bytes, with nothing written that counts. */
static PyObject *slots(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[7];
    int n_views = 0;
    long found = -1;
    if (counted(n_arguments, 7) < 0 || contiguous(arguments[6], &views[0], -1, 1) < 0)
        return NULL;
    n_views = 1;
    Py_ssize_t n = views[0].len / 2;
    static const Py_ssize_t widths[] = {4, 1, 1, 8};
    if (contiguous(arguments[0], &views[1], 2048 * 3 * 2, 0) < 0)
        goto end;
    n_views = 2;
    if (contiguous(arguments[1], &views[2], 256 * 4, 0) < 0)
        goto end;
    n_views = 3;
    for (int i = 0; i < 4; i++, n_views++)
        if (rows_of(arguments[2 + i], &views[n_views], n, widths[i]) < 0)
            goto end;
    int16_t *out = views[0].buf;
    const int16_t *table = views[1].buf;
    const uint32_t *codes = views[2].buf;
    const char *ids = views[3].buf, *dlc = views[4].buf, *flags = views[5].buf, *data = views[6].buf;
    Py_ssize_t id_step = views[3].strides[0], dlc_step = views[4].strides[0], flag_step = views[5].strides[0],
               data_step = views[6].strides[0];
    long refused = 0;
    for (Py_ssize_t i = 0; i < n; i++) {
        uint32_t can_id;
        memcpy(&can_id, ids + i * id_step, 4);
        if (dlc[i * dlc_step] != 8 || flags[i * flag_step] || can_id > 0x7FF) {
            refused = -1;
            break;
        }
        out[i] = table[can_id * 3 + codes[(unsigned char)data[i * data_step]]];
        refused += out[i] < 0;
    }
    found = refused;
end:
    release(views, n_views);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(found);
}

/* --- records ------------------------------------------------------------------------------------------------- */

/* A closed cycle of n triangles as bytes: the fields of Cycles, one after another; skin/cycles.py has them as a dtype. */
typedef struct {
    int64_t *t_mono_ns, *t_ns, *triangle_t_ns, *age_ns, *arrivals;
    uint16_t *status;
    unsigned char *counts, *missing, *late, *repeated;
} Record;

static Py_ssize_t record_bytes(Py_ssize_t n)
{
    return (18 + 39 * n + 7) / 8 * 8;
}

static Record record_of(char *bytes, Py_ssize_t n)
{
    int64_t *words = (int64_t *)bytes;
    unsigned char *rest = (unsigned char *)(words + 2 + 3 * n);
    Record record = {words, words + 1, words + 2, words + 2 + n, words + 2 + 2 * n, (uint16_t *)rest, rest + 2 * n,
                     rest + 14 * n, rest + 15 * n, rest + 15 * n + 1};
    return record;
}

/* --- assembly ------------------------------------------------------------------------------------------------ */

enum {
    SEEN, EXPECTED, RETURNING, MISSES, MISSED, ARRIVALS, CHANGES, PAYLOAD, T_NS, T_MONO_NS, NEWEST_SLOT, BOARD, SCALARS,
    N_STATE
};
enum {
    DUE_NS, OUTSTANDING, WAITING, NEWEST_T_NS, FRESH, SUPERSEDED, COMPLETE_NS, INTERVAL_NS, PROMISED_NS, SKIPPED,
    N_SCALARS
}; /* a time that there is not is NEVER */
enum { FIRST_SLOT, PERIOD_NS, LIMIT_NS, TWICE_NS, GAP_NS, PATIENCE, INTERVALS, N_NUMBERS };

typedef struct {
    Py_buffer views[N_STATE];
    Py_ssize_t n_slots;
    int64_t numbers[N_NUMBERS];
} Assembly;

static void free_assembly(PyObject *capsule)
{
    Assembly *assembly = PyCapsule_GetPointer(capsule, "assembly");
    release(assembly->views, N_STATE);
    PyMem_Free(assembly);
}

/* assembly(arrays, numbers): both in the order of their enum; the arrays are written to from then on. */
static PyObject *make_assembly(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[N_STATE] = {1, 1, 1, 8, 8, 8, 8, 8, 8, 8, 0, 8, 0};
    if (counted(n_arguments, 2) < 0)
        return NULL;
    if (PyTuple_Size(arguments[0]) != N_STATE || PyTuple_Size(arguments[1]) != N_NUMBERS) {
        if (!PyErr_Occurred())
            PyErr_Format(PyExc_ValueError, "expected %d arrays and %d numbers", N_STATE, N_NUMBERS);
        return NULL;
    }
    Assembly *assembly = PyMem_Malloc(sizeof *assembly);
    if (assembly == NULL)
        return PyErr_NoMemory();
    int held = 0;
    for (int i = 0; i < N_NUMBERS; i++)
        assembly->numbers[i] = PyLong_AsLongLong(PyTuple_GetItem(arguments[1], i));
    if (PyErr_Occurred())
        goto failed;
    if (assembly->numbers[PERIOD_NS] < 1 || assembly->numbers[INTERVALS] < 1) {
        PyErr_SetString(PyExc_ValueError, "expected a period and a number of intervals above 0");
        goto failed;
    }
    for (; held < N_STATE; held++) {
        Py_ssize_t size = held == SCALARS ? 8 * N_SCALARS : held && sizes[held] ? sizes[held] * assembly->n_slots : -1;
        if (contiguous(PyTuple_GetItem(arguments[0], held), &assembly->views[held], size, 1) < 0)
            goto failed;
        if (held == SEEN)
            assembly->n_slots = assembly->views[SEEN].len;
    }
    const int64_t *board = assembly->views[BOARD].buf;
    for (Py_ssize_t slot = 0; slot < assembly->n_slots; slot++)
        if (board[slot] < 0 || board[slot] >= assembly->views[NEWEST_SLOT].len / 2) {
            PyErr_SetString(PyExc_ValueError, "a slot has no board");
            goto failed;
        }
    PyObject *capsule = PyCapsule_New(assembly, "assembly", free_assembly);
    if (capsule != NULL)
        return capsule;
failed:
    release(assembly->views, held);
    PyMem_Free(assembly);
    return NULL;
}

/* As CycleAssembler._begin_cycle. */
static void begin_cycle(Assembly *assembly, int64_t t_close_ns, int complete)
{
    int64_t *scalars = assembly->views[SCALARS].buf;
    const unsigned char *expected = assembly->views[EXPECTED].buf;
    if (!complete || scalars[COMPLETE_NS] == NEVER)
        scalars[INTERVAL_NS] = NEVER;
    else {
        int64_t interval_ns = t_close_ns - scalars[COMPLETE_NS], intervals = assembly->numbers[INTERVALS];
        int64_t mean_ns = scalars[INTERVAL_NS] == NEVER ? interval_ns : scalars[INTERVAL_NS];
        int64_t more_ns = interval_ns - mean_ns;
        scalars[INTERVAL_NS] = mean_ns + more_ns / intervals - (more_ns % intervals < 0); /* rounded down */
    }
    scalars[PROMISED_NS] = scalars[INTERVAL_NS] == NEVER ? NEVER : t_close_ns + scalars[INTERVAL_NS];
    scalars[COMPLETE_NS] = complete ? t_close_ns : NEVER;
    scalars[OUTSTANDING] = 0;
    for (Py_ssize_t slot = 0; slot < assembly->n_slots; slot++)
        scalars[OUTSTANDING] += expected[slot];
    scalars[WAITING] = scalars[OUTSTANDING] > 0;
    scalars[DUE_NS] = t_close_ns + assembly->numbers[scalars[WAITING] ? LIMIT_NS : PERIOD_NS];
}

/* Appends the cycle as it stands to the list `closed`, as (t_mono_ns, t_ns, late, repeated, record), and begins the next. */
static int close_cycle(Assembly *assembly, int64_t t_close_ns, int late, PyObject *closed)
{
    Py_ssize_t n = assembly->n_slots / 2;
    Py_buffer *state = assembly->views;
    int64_t *scalars = state[SCALARS].buf;
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, record_bytes(n));
    if (bytes == NULL)
        return -1;
    char *start = PyBytes_AsString(bytes);
    memset(start + record_bytes(n) - 8, 0, 8); /* of which up to seven hold nothing */
    Record record = record_of(start, n);
    unsigned char *seen = state[SEEN].buf, *expected = state[EXPECTED].buf, *returning = state[RETURNING].buf;
    const int64_t *received = state[ARRIVALS].buf, *t_ns = state[T_NS].buf, *t_mono_ns = state[T_MONO_NS].buf;
    const unsigned char *payload = state[PAYLOAD].buf;
    for (Py_ssize_t i = 0; i < n; i++) {
        const unsigned char *a = payload + 16 * i, *b = a + 8;
        memcpy(record.counts + TAXELS * i, a + 1, 7);
        memcpy(record.counts + TAXELS * i + 7, b + 1, 5);
        record.status[i] = (uint16_t)(b[6] << 8 | b[7]);
        Py_ssize_t older = t_mono_ns[2 * i] <= t_mono_ns[2 * i + 1] ? 2 * i : 2 * i + 1;
        record.triangle_t_ns[i] = t_ns[older];
        record.age_ns[i] = t_mono_ns[older] == NEVER ? -1 : t_close_ns - t_mono_ns[older];
        record.arrivals[i] = received[2 * i] + received[2 * i + 1];
        record.missing[i] = (expected[2 * i] && !seen[2 * i]) || (expected[2 * i + 1] && !seen[2 * i + 1]);
    }
    int repeated = !scalars[FRESH];
    *record.t_mono_ns = t_close_ns;
    *record.t_ns = scalars[NEWEST_T_NS];
    *record.late = (unsigned char)late;
    *record.repeated = (unsigned char)repeated;
    PyObject *cycle = Py_BuildValue("LLNNN", (long long)t_close_ns, (long long)scalars[NEWEST_T_NS],
                                    PyBool_FromLong(late), PyBool_FromLong(repeated), bytes);
    int failed = cycle == NULL || PyList_Append(closed, cycle) < 0;
    Py_XDECREF(cycle);
    for (Py_ssize_t slot = 0; slot < assembly->n_slots; slot++)
        expected[slot] |= returning[slot];
    memset(returning, 0, (size_t)assembly->n_slots);
    memset(seen, 0, (size_t)assembly->n_slots);
    scalars[FRESH] = 0;
    begin_cycle(assembly, t_close_ns, !late && scalars[OUTSTANDING] == 0);
    return failed ? -1 : 0;
}

/* As CycleAssembler._skip_gap and ._close_by_time. */
static int close_by_time(Assembly *assembly, int64_t now_ns, PyObject *closed)
{
    Py_buffer *state = assembly->views;
    int64_t *scalars = state[SCALARS].buf, *misses = state[MISSES].buf, *missed = state[MISSED].buf;
    unsigned char *seen = state[SEEN].buf, *expected = state[EXPECTED].buf;
    if (now_ns - scalars[DUE_NS] > assembly->numbers[GAP_NS] && !scalars[FRESH]) {
        int64_t periods = (now_ns - scalars[DUE_NS]) / assembly->numbers[PERIOD_NS];
        scalars[SKIPPED] += periods;
        scalars[DUE_NS] += periods * assembly->numbers[PERIOD_NS];
    }
    int late = 0;
    for (Py_ssize_t slot = 0; slot < assembly->n_slots; slot++) {
        int absent = expected[slot] && !seen[slot];
        late |= expected[slot];
        missed[slot] += absent;
        misses[slot] += absent;
    }
    int64_t due_ns = scalars[DUE_NS];
    if (close_cycle(assembly, due_ns, late, closed) < 0)
        return -1;
    for (Py_ssize_t slot = 0; slot < assembly->n_slots; slot++)
        expected[slot] &= misses[slot] < assembly->numbers[PATIENCE];
    begin_cycle(assembly, due_ns, 0);
    return 0;
}

/* Frames from row `row` on into the open cycle, until its last expected half has come, or one is past its due time. Returns
   the first that was not taken. */
static Py_ssize_t absorb(Assembly *assembly, Py_ssize_t row, Py_ssize_t n, const int16_t *slot_of, const char *data,
                         Py_ssize_t data_step, const int64_t *t_ns, const int64_t *t_mono_ns)
{
    Py_buffer *state = assembly->views;
    unsigned char *seen = state[SEEN].buf, *expected = state[EXPECTED].buf, *returning = state[RETURNING].buf;
    int64_t *misses = state[MISSES].buf, *arrivals = state[ARRIVALS].buf, *changes = state[CHANGES].buf;
    uint64_t *payload = state[PAYLOAD].buf;
    int64_t *last_ns = state[T_NS].buf, *last_mono_ns = state[T_MONO_NS].buf, *scalars = state[SCALARS].buf;
    int16_t *newest_slot = state[NEWEST_SLOT].buf;
    const int64_t *board = state[BOARD].buf, *numbers = assembly->numbers;
    for (; row < n && !(scalars[WAITING] && scalars[OUTSTANDING] == 0); row++) {
        int64_t slot = slot_of[row] - numbers[FIRST_SLOT];
        if (slot < 0 || slot >= assembly->n_slots)
            continue;
        int64_t now_ns = t_mono_ns[row];
        if (scalars[DUE_NS] == NEVER)
            scalars[DUE_NS] = now_ns + numbers[LIMIT_NS];
        if (now_ns > scalars[DUE_NS])
            break;
        int64_t since_ns = now_ns - last_mono_ns[slot];
        int once_more = since_ns < numbers[TWICE_NS] && newest_slot[board[slot]] == slot;
        if (!once_more) {
            scalars[FRESH] = 1;
            if (since_ns <= numbers[LIMIT_NS]) {
                misses[slot] = 0;
                returning[slot] = 1;
            }
        }
        if (!once_more && !seen[slot]) {
            seen[slot] = 1;
            scalars[OUTSTANDING] -= expected[slot];
        } else
            scalars[SUPERSEDED]++;
        uint64_t bytes;
        memcpy(&bytes, data + row * data_step, 8);
        arrivals[slot]++;
        changes[slot] += bytes != payload[slot];
        payload[slot] = bytes;
        scalars[NEWEST_T_NS] = last_ns[slot] = t_ns[row];
        last_mono_ns[slot] = now_ns;
        newest_slot[board[slot]] = (int16_t)slot;
    }
    return row;
}

/* A list of the cycles that n frames close; NULL with an error set. */
static PyObject *feed_frames(Assembly *assembly, Py_ssize_t n, const int16_t *slot_of, const char *data,
                             Py_ssize_t data_step, const int64_t *t_ns, const int64_t *t_mono_ns)
{
    const int64_t *scalars = assembly->views[SCALARS].buf;
    PyObject *closed = PyList_New(0);
    Py_ssize_t row = 0;
    while (closed != NULL && row < n) {
        int failed = 0;
        row = absorb(assembly, row, n, slot_of, data, data_step, t_ns, t_mono_ns);
        if (scalars[WAITING] && scalars[OUTSTANDING] == 0)
            failed = close_cycle(assembly, t_mono_ns[row - 1], 0, closed);
        else if (row < n)
            failed = close_by_time(assembly, t_mono_ns[row], closed);
        if (failed)
            Py_CLEAR(closed);
    }
    return closed;
}

/* feed(assembly, slots, data, t_ns, t_mono_ns): as CycleAssembler.feed, each cycle as close_cycle makes it. */
static PyObject *feed(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[4];
    int n_views = 0;
    PyObject *closed = NULL;
    if (counted(n_arguments, 5) < 0)
        return NULL;
    Assembly *assembly = PyCapsule_GetPointer(arguments[0], "assembly");
    if (assembly == NULL || contiguous(arguments[1], &views[0], -1, 0) < 0)
        return NULL;
    Py_ssize_t n = views[n_views++].len / 2;
    if (rows_of(arguments[2], &views[1], n, 8) < 0)
        goto end;
    n_views++;
    for (; n_views < 4; n_views++)
        if (contiguous(arguments[1 + n_views], &views[n_views], 8 * n, 0) < 0)
            goto end;
    closed = feed_frames(assembly, n, views[0].buf, views[1].buf, views[1].strides[0], views[2].buf, views[3].buf);
end:
    release(views, n_views);
    return closed;
}

/* advance(assembly, now_mono_ns): as CycleAssembler.advance, each cycle as close_cycle makes it. */
static PyObject *advance(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 2) < 0)
        return NULL;
    Assembly *assembly = PyCapsule_GetPointer(arguments[0], "assembly");
    if (assembly == NULL)
        return NULL;
    int64_t now_ns = PyLong_AsLongLong(arguments[1]);
    if (now_ns == -1 && PyErr_Occurred())
        return NULL;
    const int64_t *scalars = assembly->views[SCALARS].buf;
    PyObject *closed = PyList_New(0);
    while (closed != NULL && scalars[DUE_NS] != NEVER && now_ns > scalars[DUE_NS])
        if (close_by_time(assembly, now_ns, closed) < 0)
            Py_CLEAR(closed);
    return closed;
}

/* --- sorter -------------------------------------------------------------------------------------------------- */

enum { TABLE, CODES, REFUSED, N_SORTER };
#define REASONS 5 /* in `refused`: by reason, which is minus the slot, and from here on by the address of the board */
#define UNCONFIGURED_BOARD (-2)
#define MOST_FEET 16

typedef struct {
    Py_buffer views[N_SORTER];
    PyObject *capsules; /* a tuple, which keeps the assemblies */
    Assembly *assemblies[MOST_FEET];
    Py_ssize_t n_feet, capacity;
    int16_t *slots;
} Sorter;

static void free_sorter(PyObject *capsule)
{
    Sorter *sorter = PyCapsule_GetPointer(capsule, "sorter");
    release(sorter->views, N_SORTER);
    Py_DECREF(sorter->capsules);
    PyMem_Free(sorter->slots);
    PyMem_Free(sorter);
}

/* sorter(table, codes, refused, assemblies): the tables of Streams, (REASONS + 16) int64 where it counts refused frames, and
   the assemblies of all feet. */
static PyObject *make_sorter(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[N_SORTER] = {2048 * 3 * 2, 256 * 4, 8 * (REASONS + 16)};
    if (counted(n_arguments, 4) < 0)
        return NULL;
    Py_ssize_t n_feet = PyTuple_Size(arguments[3]);
    if (n_feet < 0 || n_feet > MOST_FEET) {
        if (!PyErr_Occurred())
            PyErr_Format(PyExc_ValueError, "expected at most %d assemblies", MOST_FEET);
        return NULL;
    }
    Sorter *sorter = PyMem_Malloc(sizeof *sorter);
    if (sorter == NULL)
        return PyErr_NoMemory();
    int held = 0;
    sorter->slots = NULL;
    sorter->capacity = 0;
    sorter->n_feet = n_feet;
    for (Py_ssize_t foot = 0; foot < n_feet; foot++) {
        sorter->assemblies[foot] = PyCapsule_GetPointer(PyTuple_GetItem(arguments[3], foot), "assembly");
        if (sorter->assemblies[foot] == NULL)
            goto failed;
    }
    for (; held < N_SORTER; held++)
        if (contiguous(arguments[held], &sorter->views[held], sizes[held], held == REFUSED) < 0)
            goto failed;
    sorter->capsules = Py_NewRef(arguments[3]);
    PyObject *capsule = PyCapsule_New(sorter, "sorter", free_sorter);
    if (capsule != NULL)
        return capsule;
    Py_DECREF(sorter->capsules);
failed:
    release(sorter->views, held);
    PyMem_Free(sorter);
    return NULL;
}

/* take(sorter, block): standard data frames of 8 bytes into the assemblies. Returns (how many were refused, a list of the
   closed cycles of each foot). */
static PyObject *take(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 2) < 0)
        return NULL;
    Sorter *sorter = PyCapsule_GetPointer(arguments[0], "sorter");
    if (sorter == NULL)
        return NULL;
    Block block = block_in(arguments[1]);
    if (block.n < 0)
        return NULL;
    if (block.n > sorter->capacity) {
        int16_t *larger = PyMem_Realloc(sorter->slots, (size_t)block.n * sizeof *larger);
        if (larger == NULL)
            return PyErr_NoMemory();
        sorter->slots = larger;
        sorter->capacity = block.n;
    }
    const int16_t *table = sorter->views[TABLE].buf;
    const uint32_t *codes = sorter->views[CODES].buf;
    int64_t *refused = sorter->views[REFUSED].buf;
    long n_refused = 0;
    for (Py_ssize_t i = 0; i < block.n; i++) {
        uint32_t can_id;
        memcpy(&can_id, block.raw + 16 * i, 4);
        can_id &= 0x7FF;
        int16_t slot = table[can_id * 3 + codes[(unsigned char)block.raw[16 * i + 8]]];
        sorter->slots[i] = slot;
        if (slot < 0) {
            n_refused++;
            refused[-slot < REASONS ? -slot : 0]++;
            if (slot == UNCONFIGURED_BOARD)
                refused[REASONS + (can_id >> 4 & 0xF)]++;
        }
    }
    PyObject *by_foot = PyList_New(sorter->n_feet);
    if (by_foot == NULL)
        return NULL;
    for (Py_ssize_t foot = 0; foot < sorter->n_feet; foot++) {
        PyObject *closed = feed_frames(sorter->assemblies[foot], block.n, sorter->slots, block.raw + 8, 16, block.t_ns,
                                       block.t_mono_ns);
        if (closed == NULL || PyList_SetItem(by_foot, foot, closed) < 0) {
            Py_DECREF(by_foot);
            return NULL;
        }
    }
    return Py_BuildValue("lN", n_refused, by_foot);
}

static PyObject *time_or_none(int64_t ns)
{
    return ns == NEVER ? Py_NewRef(Py_None) : PyLong_FromLongLong(ns);
}

/* expected(sorter): (due_ns, outstanding, promised_ns), as SkinReader.expected. */
static PyObject *expected_of_all(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 1) < 0)
        return NULL;
    Sorter *sorter = PyCapsule_GetPointer(arguments[0], "sorter");
    if (sorter == NULL)
        return NULL;
    int64_t due_ns = NEVER, outstanding = NEVER, promised_ns = NEVER;
    int in_rhythm = 1;
    for (Py_ssize_t foot = 0; foot < sorter->n_feet; foot++) {
        const int64_t *scalars = sorter->assemblies[foot]->views[SCALARS].buf;
        if (scalars[DUE_NS] != NEVER && (due_ns == NEVER || scalars[DUE_NS] < due_ns))
            due_ns = scalars[DUE_NS];
        if (!scalars[OUTSTANDING])
            continue;
        if (outstanding == NEVER || scalars[OUTSTANDING] < outstanding)
            outstanding = scalars[OUTSTANDING];
        if (scalars[PROMISED_NS] == NEVER)
            in_rhythm = 0;
        else if (promised_ns == NEVER || scalars[PROMISED_NS] < promised_ns)
            promised_ns = scalars[PROMISED_NS];
    }
    return Py_BuildValue("NNN", time_or_none(due_ns), time_or_none(outstanding),
                         time_or_none(in_rhythm ? promised_ns : NEVER));
}

/* --- reader -------------------------------------------------------------------------------------------------- */

enum { USABLE, N_READINGS, RESTS_AT_255, FLAGS_WORK, BASELINE, COEFFICIENTS, LOWEST, ROWS, N_CONSTANTS };

typedef struct {
    Py_buffer views[N_CONSTANTS];
    Py_ssize_t n_triangles, n_coefficients;
    uint64_t stale_ns;
    double threshold_count, min_pressure_pa;
} Reader;

static void free_reader(PyObject *capsule)
{
    Reader *reader = PyCapsule_GetPointer(capsule, "reader");
    release(reader->views, N_CONSTANTS);
    PyMem_Free(reader);
}

/* reader(arrays, n_coefficients, stale_after_ns, activation_threshold_count, min_pressure_pa): arrays as in the enum. */
static PyObject *make_reader(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 5) < 0)
        return NULL;
    if (PyTuple_Size(arguments[0]) != N_CONSTANTS) {
        if (!PyErr_Occurred())
            PyErr_Format(PyExc_ValueError, "expected %d arrays", N_CONSTANTS);
        return NULL;
    }
    Reader *reader = PyMem_Malloc(sizeof *reader);
    if (reader == NULL)
        return PyErr_NoMemory();
    int held = 0;
    reader->n_coefficients = PyLong_AsSsize_t(arguments[1]);
    reader->stale_ns = PyLong_AsUnsignedLongLong(arguments[2]);
    reader->threshold_count = PyFloat_AsDouble(arguments[3]);
    reader->min_pressure_pa = PyFloat_AsDouble(arguments[4]);
    if (PyErr_Occurred())
        goto failed;
    if (contiguous(PyTuple_GetItem(arguments[0], USABLE), &reader->views[USABLE], -1, 0) < 0)
        goto failed;
    held = 1;
    Py_ssize_t n = reader->n_triangles = reader->views[USABLE].len / TAXELS;
    if (n < 1 || n > MOST_TRIANGLES || reader->views[USABLE].len != n * TAXELS || reader->n_coefficients < 1) {
        PyErr_Format(PyExc_ValueError, "expected 1 to %d triangles of %d taxels", MOST_TRIANGLES, TAXELS);
        goto failed;
    }
    Py_ssize_t taxels = 8 * TAXELS * n;
    Py_ssize_t sizes[N_CONSTANTS] = {0, n, n, n, taxels, taxels * reader->n_coefficients, taxels, 3 * taxels};
    for (; held < N_CONSTANTS; held++)
        if (contiguous(PyTuple_GetItem(arguments[0], held), &reader->views[held], sizes[held], 0) < 0)
            goto failed;
    PyObject *capsule = PyCapsule_New(reader, "reader", free_reader);
    if (capsule != NULL)
        return capsule;
failed:
    release(reader->views, held);
    PyMem_Free(reader);
    return NULL;
}

/* The sum of n ≥ 8 numbers in the order in which numpy's add.reduce takes them (pairwise; Higham 1993). */
static double pairwise_sum(const double *x, Py_ssize_t n)
{
    if (n > 128) {
        Py_ssize_t half = n / 2;
        half -= half % 8;
        return pairwise_sum(x, half) + pairwise_sum(x + half, n - half);
    }
    double r[8];
    memcpy(r, x, sizeof r);
    Py_ssize_t i = 8;
    for (; i < n - n % 8; i += 8)
        for (int k = 0; k < 8; k++)
            r[k] += x[i + k];
    double sum = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    for (; i < n; i++)
        sum += x[i];
    return sum;
}

typedef struct {
    int extrapolated; /* a valid taxel reads below what its curve was fitted to */
    long n_valid, n_in_contact;
    double wrench[3]; /* f_z_n, m_x_nm, m_y_nm */
} Sums;

static void sum_wrench(Sums *sums, const double *rows, const double *counted_pa, Py_ssize_t n_taxels)
{
    double product[TAXELS * MOST_TRIANGLES];
    for (int k = 0; k < 3; k++) {
        for (Py_ssize_t at = 0; at < n_taxels; at++)
            product[at] = rows[k * n_taxels + at] * counted_pa[at];
        sums->wrench[k] = pairwise_sum(product, n_taxels);
    }
}

/* One cycle into valid, pressure (twice) and age_ms. */
static Sums read_into(const Reader *reader, const unsigned char *counts, const uint16_t *status, const int64_t *age_ns,
                      const unsigned char *masked, unsigned char *valid, double *pressure, float *pressure_f4,
                      float *age_ms)
{
    Sums sums = {0, 0, 0, {0.0, 0.0, 0.0}};
    Py_ssize_t n = reader->n_triangles, n_taxels = TAXELS * n;
    const Py_buffer *constants = reader->views;
    const unsigned char *usable = constants[USABLE].buf, *n_readings = constants[N_READINGS].buf,
                        *rests_at_255 = constants[RESTS_AT_255].buf, *flags_work = constants[FLAGS_WORK].buf;
    const double *baseline = constants[BASELINE].buf, *lowest = constants[LOWEST].buf, *rows = constants[ROWS].buf;
    const double *last = (const double *)constants[COEFFICIENTS].buf + (reader->n_coefficients - 1) * n_taxels;
    double counted_pa[TAXELS * MOST_TRIANGLES];
    for (Py_ssize_t i = 0; i < n; i++) {
        int believed = (uint64_t)age_ns[i] <= reader->stale_ns && (status[i] & 0xF) == 0;
        age_ms[i] = age_ns[i] < 0 ? (float)NAN : (float)((double)age_ns[i] * 1e-6);
        for (int taxel = 0; taxel < TAXELS; taxel++) {
            Py_ssize_t at = TAXELS * i + taxel;
            unsigned char count = counts[at];
            int pad = taxel == 6 || taxel == 10;
            int flagged = status[i] >> (4 + taxel) & 1 && flags_work[i] && !(count == 255 && rests_at_255[i]);
            int good = believed && !pad && (unsigned char)(count - 1) < n_readings[i] && !flagged && usable[at]
                       && !masked[at];
            double activation = baseline[at] - count;
            const double *coefficient = last + at;
            double value = reader->n_coefficients == 1 ? *coefficient : *coefficient * activation;
            for (Py_ssize_t k = reader->n_coefficients - 2; k > 0; k--) {
                coefficient -= n_taxels;
                value = (value + *coefficient) * activation;
            }
            if (reader->n_coefficients > 1)
                value += *(coefficient - n_taxels);
            if (reader->threshold_count > 0 && activation < reader->threshold_count)
                value = 0.0;
            sums.extrapolated |= good && count < lowest[at];
            valid[at] = (unsigned char)good;
            pressure[at] = value;
            pressure_f4[at] = (float)value;
            counted_pa[at] = good ? value : 0.0;
            sums.n_valid += good;
            sums.n_in_contact += good && value >= reader->min_pressure_pa;
        }
    }
    sum_wrench(&sums, rows, counted_pa, n_taxels);
    return sums;
}

static PyObject *tuple_of_sums(const Sums *sums)
{
    return Py_BuildValue("illddd", sums->extrapolated, sums->n_valid, sums->n_in_contact, sums->wrench[0],
                         sums->wrench[1], sums->wrench[2]);
}

/* read(reader, counts, status, age_ns, masked, valid, pressure_pa, pressure_pa_f4, age_ms): one cycle into the last four
   arrays. Returns (extrapolated, n_valid, n_in_contact, f_z_n, m_x_nm, m_y_nm). */
static PyObject *read_cycle(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[] = {TAXELS, 2, 8, TAXELS, TAXELS, 8 * TAXELS, 4 * TAXELS, 4};
    Py_buffer views[8];
    int n_views = 0;
    PyObject *result = NULL;
    if (counted(n_arguments, 9) < 0)
        return NULL;
    Reader *reader = PyCapsule_GetPointer(arguments[0], "reader");
    if (reader == NULL)
        return NULL;
    for (; n_views < 8; n_views++) {
        Py_ssize_t size = sizes[n_views] * reader->n_triangles;
        if (contiguous(arguments[1 + n_views], &views[n_views], size, n_views >= 4) < 0)
            goto end;
    }
    Sums sums = read_into(reader, views[0].buf, views[1].buf, views[2].buf, views[3].buf, views[4].buf, views[5].buf,
                          views[6].buf, views[7].buf);
    result = tuple_of_sums(&sums);
end:
    release(views, n_views);
    return result;
}

/* --- messages ------------------------------------------------------------------------------------------------ */

/* What stands between the fixed bytes of a template; wire/templates.py has the same numbers. */
enum {
    END, SEQ, NEWEST_NS, PUBLISHED_NS, COUNTS, STATUS, TRIANGLE_T_NS, AGES, MISSING, IS_VALID, LATE, REPEATED, PRESSURE_PA,
    LOAD_NS, LOAD_PA, BEYOND,
    NUMBERS /* the fields of mechanics.wrench.Wrench, those of the dynamic model, and its beyond_fraction */
};
#define MOST_NUMBERS 21
#define N_CODES (NUMBERS + MOST_NUMBERS)
#define MOST_TEMPLATES 4

enum { MASKED, TOP_IS_RAIL, LOOSE, VALID, PRESSURE, PRESSURE_F4, AGE_MS, LOAD_F4, IS_BEYOND, N_WORK };

typedef struct {
    PyObject *reader_capsule;
    const Reader *reader;
    Py_buffer work[N_WORK], templates[MOST_TEMPLATES];
    int n_templates, n_numbers;
    int64_t late_ns;
    char *packed; /* room for the longest message */
    Py_ssize_t most_bytes;
} Messages;

static void free_messages(PyObject *capsule)
{
    Messages *messages = PyCapsule_GetPointer(capsule, "messages");
    release(messages->work, N_WORK);
    release(messages->templates, messages->n_templates);
    Py_DECREF(messages->reader_capsule);
    PyMem_Free(messages->packed);
    PyMem_Free(messages);
}

/* The most bytes that a message of `template` has, or -1 with an error set where it is none: pieces of a length (2 bytes,
   the low one first), so many bytes of the message, and the code of what follows them; the last has END. */
static Py_ssize_t most_bytes_of(const Py_buffer *template, Py_ssize_t n_triangles, int *n_numbers)
{
    const unsigned char *at = template->buf, *end = at + template->len;
    Py_ssize_t most = 0;
    while (end - at >= 3) {
        Py_ssize_t length = at[0] | at[1] << 8;
        if (end - at < length + 3)
            break;
        int code = at[2 + length];
        at += length + 3;
        most += length + 9;
        if (code == END && at == end)
            return most;
        if (code == END || code >= N_CODES)
            break;
        if (code - NUMBERS >= *n_numbers)
            *n_numbers = code - NUMBERS + 1;
        if (code >= COUNTS && code < NUMBERS)
            most += 4 * TAXELS * n_triangles;
    }
    PyErr_SetString(PyExc_ValueError, "expected the template of a message");
    return -1;
}

/* messages(reader, arrays, templates, late_ns): arrays in the order of the enum, those from VALID on are written to from
   then on; a tuple of templates, in the order in which pack_record gives the messages; by how much the dynamic model's load
   is older than the newest frame. */
static PyObject *make_messages(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[N_WORK] = {TAXELS, 1, 1, TAXELS, 8 * TAXELS, 4 * TAXELS, 4, 4 * TAXELS, TAXELS};
    if (counted(n_arguments, 4) < 0)
        return NULL;
    Reader *reader = PyCapsule_GetPointer(arguments[0], "reader");
    int64_t late_ns = PyLong_AsLongLong(arguments[3]);
    if (reader == NULL || PyErr_Occurred())
        return NULL;
    Py_ssize_t n_templates = number_of_items(arguments[1], N_WORK, arguments[2], MOST_TEMPLATES, "templates");
    if (n_templates < 0)
        return NULL;
    Messages *messages = PyMem_Malloc(sizeof *messages);
    if (messages == NULL)
        return PyErr_NoMemory();
    int held = 0;
    messages->n_templates = messages->n_numbers = 0;
    messages->late_ns = late_ns;
    messages->most_bytes = 0;
    for (; held < N_WORK; held++) {
        PyObject *array = PyTuple_GetItem(arguments[1], held);
        if (contiguous(array, &messages->work[held], sizes[held] * reader->n_triangles, held >= VALID) < 0)
            goto failed;
    }
    for (; messages->n_templates < n_templates; messages->n_templates++) {
        Py_buffer *template = &messages->templates[messages->n_templates];
        if (contiguous(PyTuple_GetItem(arguments[2], messages->n_templates), template, -1, 0) < 0)
            goto failed;
        Py_ssize_t most = most_bytes_of(template, reader->n_triangles, &messages->n_numbers);
        if (most < 0) {
            PyBuffer_Release(template);
            goto failed;
        }
        if (most > messages->most_bytes)
            messages->most_bytes = most;
    }
    messages->packed = PyMem_Malloc((size_t)messages->most_bytes + 1);
    if (messages->packed == NULL) {
        PyErr_NoMemory();
        goto failed;
    }
    messages->reader = reader;
    messages->reader_capsule = Py_NewRef(arguments[0]);
    PyObject *capsule = PyCapsule_New(messages, "messages", free_messages);
    if (capsule != NULL)
        return capsule;
    Py_DECREF(messages->reader_capsule);
    PyMem_Free(messages->packed);
failed:
    release(messages->work, held);
    release(messages->templates, messages->n_templates);
    PyMem_Free(messages);
    return NULL;
}

/* The record in a bytes object, whose t_mono_ns is NULL with an error set where it is none of n triangles. */
static Record record_in(PyObject *object, Py_ssize_t n)
{
    Record none = {NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL};
    Py_ssize_t size = PyBytes_Size(object);
    if (size < 0)
        return none;
    if (size != record_bytes(n)) {
        PyErr_Format(PyExc_ValueError, "expected a record of %zd bytes, found %zd", record_bytes(n), size);
        return none;
    }
    return record_of(PyBytes_AsString(object), n);
}

/* Whether a triangle that is not loose has a thermal pad on a rail, or reads as a chip that answers 0. */
static int may_any_be_loose(const unsigned char *counts, const unsigned char *top_is_rail, const unsigned char *loose,
                            Py_ssize_t n)
{
    int any = 0;
    for (Py_ssize_t i = 0; i < n; i++, counts += TAXELS)
        any |= !loose[i] && (counts[6] == 0 || counts[10] == 0
                             || (top_is_rail[i] ? counts[6] == 255 || counts[10] == 255 : counts[9] == 0));
    return any;
}

/* read_record(messages, record, screened): a record into the arrays of `messages`, and what `read` returns; or None where a
   triangle may have come loose in it, unless it was screened or nothing new arrived. */
static PyObject *read_record(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 3) < 0)
        return NULL;
    Messages *messages = PyCapsule_GetPointer(arguments[0], "messages");
    if (messages == NULL)
        return NULL;
    Py_ssize_t n = messages->reader->n_triangles;
    Record record = record_in(arguments[1], n);
    int screened = PyObject_IsTrue(arguments[2]);
    if (record.t_mono_ns == NULL || screened < 0)
        return NULL;
    Py_buffer *work = messages->work;
    if (!screened && !*record.repeated
        && may_any_be_loose(record.counts, work[TOP_IS_RAIL].buf, work[LOOSE].buf, n))
        return Py_NewRef(Py_None);
    Sums sums = read_into(messages->reader, record.counts, record.status, record.age_ns, work[MASKED].buf,
                          work[VALID].buf, work[PRESSURE].buf, work[PRESSURE_F4].buf, work[AGE_MS].buf);
    return tuple_of_sums(&sums);
}

/* pack_record(messages, record, seq, published_ns, numbers): a tuple of the payloads of the record that was read last;
   `numbers` is a tuple of those from NUMBERS on, to the last that its templates have. */
static PyObject *pack_record(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    double numbers[MOST_NUMBERS];
    if (counted(n_arguments, 5) < 0)
        return NULL;
    Messages *messages = PyCapsule_GetPointer(arguments[0], "messages");
    if (messages == NULL)
        return NULL;
    Py_ssize_t n = messages->reader->n_triangles;
    Record record = record_in(arguments[1], n);
    if (record.t_mono_ns == NULL)
        return NULL;
    int64_t seq = PyLong_AsLongLong(arguments[2]), published_ns = PyLong_AsLongLong(arguments[3]);
    if (PyTuple_Size(arguments[4]) < messages->n_numbers && !PyErr_Occurred())
        PyErr_Format(PyExc_ValueError, "expected at least %d numbers", messages->n_numbers);
    for (int i = 0; i < messages->n_numbers && !PyErr_Occurred(); i++)
        numbers[i] = PyFloat_AsDouble(PyTuple_GetItem(arguments[4], i));
    PyObject *payloads = PyErr_Occurred() ? NULL : PyTuple_New(messages->n_templates);
    if (payloads == NULL)
        return NULL;
    Py_buffer *work = messages->work;
    for (int kind = 0; kind < messages->n_templates; kind++) {
        Writer out = {messages->packed, messages->packed + messages->most_bytes};
        const unsigned char *at = messages->templates[kind].buf;
        int code, failed = 0;
        do {
            Py_ssize_t length = at[0] | at[1] << 8;
            code = at[2 + length];
            failed |= put(&out, at + 2, length);
            at += length + 3;
            switch (code) {
            case END: break;
            case SEQ: failed |= put_signed(&out, seq); break;
            case NEWEST_NS: failed |= put_signed(&out, *record.t_ns); break;
            case PUBLISHED_NS: failed |= put_signed(&out, published_ns); break;
            case COUNTS: failed |= put_long(&out, record.counts, TAXELS * n, 0xC4); break;
            case STATUS: failed |= put_long(&out, record.status, 2 * n, 0xC4); break;
            case TRIANGLE_T_NS: failed |= put_long(&out, record.triangle_t_ns, 8 * n, 0xC4); break;
            case AGES: failed |= put_long(&out, work[AGE_MS].buf, 4 * n, 0xC4); break;
            case MISSING: failed |= put_long(&out, record.missing, n, 0xC4); break;
            case IS_VALID: failed |= put_long(&out, work[VALID].buf, TAXELS * n, 0xC4); break;
            case LATE: failed |= put_number(&out, *record.late ? 0xC3 : 0xC2, 0, 0); break;
            case REPEATED: failed |= put_number(&out, *record.repeated ? 0xC3 : 0xC2, 0, 0); break;
            case PRESSURE_PA: failed |= put_long(&out, work[PRESSURE_F4].buf, 4 * TAXELS * n, 0xC4); break;
            case LOAD_NS: failed |= put_signed(&out, *record.t_ns - messages->late_ns); break;
            case LOAD_PA: failed |= put_long(&out, work[LOAD_F4].buf, 4 * TAXELS * n, 0xC4); break;
            case BEYOND: failed |= put_long(&out, work[IS_BEYOND].buf, TAXELS * n, 0xC4); break;
            default: failed |= put_float(&out, numbers[code - NUMBERS]);
            }
        } while (code != END && !failed);
        PyObject *payload = failed ? NULL : PyBytes_FromStringAndSize(messages->packed, out.at - messages->packed);
        if (payload == NULL || PyTuple_SetItem(payloads, kind, payload) < 0) {
            Py_DECREF(payloads);
            return NULL;
        }
    }
    return payloads;
}

/* --- inverse ------------------------------------------------------------------------------------------------- */

/* The kinds of a stage, and its arrays; physics/kernel_stage.py has the same. */
enum { RELAXATION, RELAXATION_FROM_REST, HYSTERESIS, LAG, N_KINDS };
enum { COLUMNS, NEIGHBOURS, AT_ONCE, FIRST, SECOND, MEMORY, N_STAGE };
#define MOST_STAGES 16
#define MOST_TERMS 64
#define READINGS 5 /* of a lag; these four as effects/lag.py and effects/hysteresis.py have them */
#define LAG_PERIOD_S 0.02
#define LAG_NO_CURVE 1e-9
#define REMEMBERED_S 0.025

/* One law with k terms on m columns; each of its numbers is one for all columns, or one of each. */
typedef struct {
    int kind;
    Py_ssize_t k, m, n_near;
    Py_buffer views[N_STAGE];
} Stage;

enum { HIGHEST_PA, LAST_VALUES, LAST_T_S, N_INVERSE };

typedef struct {
    Py_buffer views[N_INVERSE];
    Py_ssize_t n_taxels;
    int n_stages;
    Stage stages[MOST_STAGES];
} Inverse;

static void release_inverse(Inverse *inverse, int n_views)
{
    while (inverse->n_stages)
        release(inverse->stages[--inverse->n_stages].views, N_STAGE);
    release(inverse->views, n_views);
    PyMem_Free(inverse);
}

static void free_inverse(PyObject *capsule)
{
    release_inverse(PyCapsule_GetPointer(capsule, "inverse"), N_INVERSE);
}

static Py_ssize_t length(const Py_buffer *view)
{
    return view->len / 8;
}

/* How many numbers a stage remembers. */
static Py_ssize_t memory_of(const Stage *stage)
{
    Py_ssize_t k = stage->k, m = stage->m;
    return stage->kind == LAG ? (READINGS - 1) * (m + 1)
         : stage->kind == HYSTERESIS ? k * m + 2 * m + 1
                                     : k * m + m + length(&stage->views[SECOND]);
}

static int is_whole(const Stage *stage, Py_ssize_t n_taxels)
{
    const Py_buffer *views = stage->views;
    Py_ssize_t k = stage->k, m = stage->m;
    if (stage->kind < 0 || stage->kind >= N_KINDS || k < 1 || k > MOST_TERMS || m < 1 || m > n_taxels)
        return 0;
    for (int i = AT_ONCE; i <= SECOND; i++) {
        Py_ssize_t terms = i == AT_ONCE ? 1 : k;
        if (length(&views[i]) != terms && length(&views[i]) != terms * m)
            return 0;
    }
    if ((stage->kind == HYSTERESIS) != (stage->n_near > 0) || length(&views[MEMORY]) != memory_of(stage))
        return 0;
    const int64_t *columns = views[COLUMNS].buf, *neighbours = views[NEIGHBOURS].buf;
    for (Py_ssize_t i = 0; i < m; i++)
        if (columns[i] < 0 || columns[i] >= n_taxels)
            return 0;
    for (Py_ssize_t i = 0; i < stage->n_near * m; i++)
        if (neighbours[i] < 0 || neighbours[i] >= m)
            return 0;
    return 1;
}

static int hold_stage(Stage *stage, PyObject *tuple, Py_ssize_t n_taxels)
{
    int held = 0;
    if (PyTuple_Size(tuple) != N_STAGE + 2)
        goto failed;
    stage->kind = (int)PyLong_AsLong(PyTuple_GetItem(tuple, 0));
    stage->k = PyLong_AsSsize_t(PyTuple_GetItem(tuple, 1));
    for (; held < N_STAGE; held++)
        if (contiguous(PyTuple_GetItem(tuple, 2 + held), &stage->views[held], -1, held == MEMORY) < 0)
            goto failed;
    stage->m = length(&stage->views[COLUMNS]);
    stage->n_near = stage->m ? length(&stage->views[NEIGHBOURS]) / stage->m : 0;
    if (is_whole(stage, n_taxels))
        return 0;
failed:
    release(stage->views, held);
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "expected a stage with its columns, its values and its memory");
    return -1;
}

/* inverse(arrays, stages): arrays in the order of the enum, the last two written to; each stage a tuple of its kind, how
   many terms it has, and its arrays, the last written to. */
static PyObject *make_inverse(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    if (counted(n_arguments, 2) < 0)
        return NULL;
    Py_ssize_t n_stages = number_of_items(arguments[0], N_INVERSE, arguments[1], MOST_STAGES, "stages");
    if (n_stages < 0)
        return NULL;
    Inverse *inverse = PyMem_Malloc(sizeof *inverse);
    if (inverse == NULL)
        return PyErr_NoMemory();
    int held = 0;
    inverse->n_stages = 0;
    inverse->n_taxels = 0;
    for (; held < N_INVERSE; held++) {
        Py_ssize_t size = held == HIGHEST_PA ? -1 : held == LAST_T_S ? 8 : 8 * inverse->n_taxels;
        if (contiguous(PyTuple_GetItem(arguments[0], held), &inverse->views[held], size, held != HIGHEST_PA) < 0)
            goto failed;
        if (held == HIGHEST_PA)
            inverse->n_taxels = length(&inverse->views[held]);
    }
    if (inverse->n_taxels < 1 || inverse->n_taxels > TAXELS * MOST_TRIANGLES) {
        PyErr_Format(PyExc_ValueError, "expected 1 to %d taxels", TAXELS * MOST_TRIANGLES);
        goto failed;
    }
    for (; inverse->n_stages < n_stages; inverse->n_stages++)
        if (hold_stage(&inverse->stages[inverse->n_stages], PyTuple_GetItem(arguments[1], inverse->n_stages),
                       inverse->n_taxels) < 0)
            goto failed;
    PyObject *capsule = PyCapsule_New(inverse, "inverse", free_inverse);
    if (capsule != NULL)
        return capsule;
failed:
    release_inverse(inverse, held);
    return NULL;
}

/* As portable.exp_minus_one. */
static double exp_minus_one(double x)
{
    static const double coefficients[] = {
        1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800,
        1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800};
    x = x < -700.0 ? -700.0 : x;
    double power = rint(x * (1 / 0.6931471805599453));
    double r = (x - power * 6.93147180369123816490e-01) - power * 1.90821492927058770002e-10;
    double scale = ldexp(1.0, (int)power), result = coefficients[12];
    for (int k = 11; k >= 0; k--)
        result = result * r + coefficients[k];
    return result * r * scale + (scale - 1.0);
}

typedef struct {
    double decay, before, now;
} FirstOrderStep;

/* As first_order.steps. */
static FirstOrderStep step_of(double dt_s, double tau_s)
{
    double x = dt_s / tau_s;
    x = x < 1e-300 ? 1e-300 : x;
    double approached = -exp_minus_one(-x), mean = approached / x;
    FirstOrderStep step = {1.0 - approached, mean - 1.0 + approached, 1.0 - mean};
    return step;
}

/* Number `i` of term k among m columns. */
static double value_of(const Py_buffer *view, Py_ssize_t n_terms, Py_ssize_t k, Py_ssize_t i)
{
    const double *values = view->buf;
    return length(view) == n_terms ? values[k] : values[k * (length(view) / n_terms) + i];
}

/* As relaxation.Relaxation, its inverse. */
static void relax(const Stage *stage, double *x, double dt_s, int begins)
{
    Py_ssize_t k_most = stage->k, m = stage->m, n_tau = length(&stage->views[SECOND]) / k_most;
    double *known = stage->views[MEMORY].buf, *load = known + k_most * m, *previous_now = load + m;
    FirstOrderStep steps[MOST_TERMS];
    double drive[MOST_TERMS];
    for (Py_ssize_t i = 0; i < m; i++) {
        if (begins) {
            load[i] = 0.0;
            for (Py_ssize_t k = 0; k < k_most; k++)
                known[k * m + i] = value_of(&stage->views[FIRST], k_most, k, i) * (stage->kind == RELAXATION ? x[i] : 0.0);
        }
        double immediate = 0.0, total = 0.0;
        for (Py_ssize_t k = 0; k < k_most; k++) {
            if (i == 0 || n_tau > 1) {
                double *previous = &previous_now[k * n_tau + i];
                steps[k] = step_of(dt_s, value_of(&stage->views[SECOND], k_most, k, i));
                drive[k] = steps[k].before + steps[k].decay * (begins ? 0.0 : *previous);
                *previous = steps[k].now;
            }
            double a = value_of(&stage->views[FIRST], k_most, k, i), *w = &known[k * m + i];
            immediate += a * steps[k].now;
            *w = *w * steps[k].decay + drive[k] * a * load[i];
            total += *w;
        }
        immediate = value_of(&stage->views[AT_ONCE], 1, 0, i) + immediate;
        load[i] = x[i] = x[i] / immediate - total / immediate;
    }
}

static double play(double last, double x, double r)
{
    double moved = last < x + r ? last : x + r;
    return moved > x - r ? moved : x - r;
}

/* As effects.hysteresis, its live inverse. */
static void undo_hysteresis(const Stage *stage, double *x, double dt_s, int begins)
{
    Py_ssize_t k_most = stage->k, m = stage->m;
    const int64_t *near = stage->views[NEIGHBOURS].buf;
    double *plays = stage->views[MEMORY].buf, *known = plays + k_most * m, *load = known + m, *previous_now = load + m;
    double local_mean[TAXELS * MOST_TRIANGLES];
    FirstOrderStep step = step_of(dt_s, REMEMBERED_S);
    double drive = step.before + step.decay * (begins ? 0.0 : *previous_now);
    *previous_now = step.now;
    for (Py_ssize_t i = 0; i < m; i++, near += stage->n_near) {
        local_mean[i] = 0.0;
        for (Py_ssize_t j = 0; j < stage->n_near; j++)
            local_mean[i] += x[near[j]];
        local_mean[i] /= (double)stage->n_near;
    }
    for (Py_ssize_t i = 0; i < m; i++) {
        if (begins) {
            known[i] = local_mean[i];
            load[i] = 0.0;
        }
        known[i] = known[i] * step.decay + drive * load[i];
        load[i] = local_mean[i];
        double remembered = local_mean[i] * step.now + known[i], undone = 0.0;
        for (Py_ssize_t k = 0; k < k_most; k++) {
            double r = value_of(&stage->views[FIRST], k_most, k, i), *y = &plays[k * m + i];
            undone += play(*y, local_mean[i], r) * value_of(&stage->views[SECOND], k_most, k, i);
            *y = play(*y, remembered, r);
        }
        undone += value_of(&stage->views[AT_ONCE], 1, 0, i) * local_mean[i];
        x[i] = x[i] + undone - local_mean[i];
    }
}

/* As effects.lag, its live inverse: AT_ONCE has the factors of the slope, FIRST those of the curvature. */
static void undo_lag(const Stage *stage, double *x, double t_s, int begins)
{
    Py_ssize_t m = stage->m;
    double *last_x = stage->views[MEMORY].buf, *last_t_s = last_x + (READINGS - 1) * m;
    double t[READINGS], first[READINGS], second[READINGS], sum = 0.0, square = 0.0, cube = 0.0, norm = 0.0;
    for (int j = 0; j < READINGS - 1; j++) {
        if (begins) {
            last_t_s[j] = t_s - LAG_PERIOD_S * (READINGS - 1 - j);
            memcpy(last_x + j * m, x, (size_t)m * sizeof *x);
        }
        t[j] = (last_t_s[j] - t_s) / LAG_PERIOD_S;
        sum += t[j];
    }
    t[READINGS - 1] = 0.0;
    double mean = sum / READINGS;
    for (int j = 0; j < READINGS; j++) {
        first[j] = t[j] - mean;
        square += first[j] * first[j];
        cube += first[j] * first[j] * first[j];
    }
    square += LAG_NO_CURVE;
    double skew = cube / square, spread = square / READINGS;
    for (int j = 0; j < READINGS; j++) {
        second[j] = first[j] * first[j] - skew * first[j] - spread;
        norm += second[j] * second[j];
    }
    norm += LAG_NO_CURVE;
    double now = mean * mean + skew * mean - spread, slope_now = -2.0 * mean - skew;
    for (Py_ssize_t i = 0; i < m; i++) {
        double slope = value_of(&stage->views[AT_ONCE], 1, 0, i), curvature = value_of(&stage->views[FIRST], 1, 0, i);
        double of_first = (slope - mean) / square, of_second = (now + slope * slope_now + curvature) / norm, load = 0.0;
        for (int j = 0; j < READINGS; j++) {
            double q = j < READINGS - 1 ? last_x[j * m + i] : x[i];
            double weighted = (1.0 / READINGS + first[j] * of_first + second[j] * of_second) * q;
            load = j ? load + weighted : weighted;
            if (j)
                last_x[(j - 1) * m + i] = q;
        }
        x[i] = load;
    }
    memmove(last_t_s, last_t_s + 1, (READINGS - 2) * sizeof *last_t_s);
    last_t_s[READINGS - 2] = t_s;
}

/* invert(inverse, static_pa, counts, valid, highest_count, t_s, pressure_pa, beyond): as DynamicModel, one cycle into the
   last two arrays; taxels that read more than `highest_count` bear nothing, None: they do. Returns how many are beyond, -1
   and nothing done if time goes back. */
static PyObject *invert(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const int places[] = {1, 2, 3, 6, 7, 4}; /* of the arrays among the arguments */
    static const Py_ssize_t sizes[] = {8, 1, 1, 8, 1, 8};
    Py_buffer views[6];
    int n_views = 0;
    long n_beyond = -1;
    if (counted(n_arguments, 8) < 0)
        return NULL;
    Inverse *inverse = PyCapsule_GetPointer(arguments[0], "inverse");
    if (inverse == NULL)
        return NULL;
    Py_ssize_t n = inverse->n_taxels;
    double t_s = PyFloat_AsDouble(arguments[5]);
    if (PyErr_Occurred())
        return NULL;
    for (int n_arrays = arguments[4] == Py_None ? 5 : 6; n_views < n_arrays; n_views++)
        if (contiguous(arguments[places[n_views]], &views[n_views], sizes[n_views] * n, n_views == 3 || n_views == 4) < 0)
            goto end;
    const double *static_pa = views[0].buf, *highest_count = n_views > 5 ? views[5].buf : NULL;
    const unsigned char *counts = views[1].buf, *valid = views[2].buf;
    double *pressure = views[3].buf, x[TAXELS * MOST_TRIANGLES], excess[TAXELS * MOST_TRIANGLES];
    unsigned char *beyond = views[4].buf;
    const double *highest_pa = inverse->views[HIGHEST_PA].buf;
    double *last = inverse->views[LAST_VALUES].buf, *last_t_s = inverse->views[LAST_T_S].buf;
    int begins = isnan(*last_t_s);
    double dt_s = begins ? 0.0 : t_s - *last_t_s;
    if (dt_s < 0)
        goto end;
    n_beyond = 0;
    *last_t_s = t_s;
    for (Py_ssize_t i = 0; i < n; i++) {
        double effective = highest_count != NULL && !(counts[i] <= highest_count[i]) ? 0.0 : static_pa[i];
        double above = valid[i] ? effective - highest_pa[i] : 0.0;
        excess[i] = above > 0 ? above : 0.0;
        n_beyond += beyond[i] = excess[i] > 0;
        x[i] = last[i] = valid[i] ? effective - excess[i] : last[i];
    }
    for (int k = 0; k < inverse->n_stages; k++) {
        const Stage *stage = &inverse->stages[k];
        const int64_t *columns = stage->views[COLUMNS].buf;
        double of_columns[TAXELS * MOST_TRIANGLES];
        for (Py_ssize_t i = 0; i < stage->m; i++)
            of_columns[i] = x[columns[i]];
        if (stage->kind == LAG)
            undo_lag(stage, of_columns, t_s, begins);
        else if (stage->kind == HYSTERESIS)
            undo_hysteresis(stage, of_columns, dt_s, begins);
        else
            relax(stage, of_columns, dt_s, begins);
        for (Py_ssize_t i = 0; i < stage->m; i++)
            x[columns[i]] = of_columns[i];
    }
    for (Py_ssize_t i = 0; i < n; i++) {
        int is_loaded = valid[i] && !(highest_count != NULL && !(counts[i] <= highest_count[i]));
        pressure[i] = is_loaded ? x[i] + excess[i] : static_pa[i];
    }
end:
    release(views, n_views);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(n_beyond);
}

/* sum(pressure_pa, valid, rows, min_pressure_pa, pressure_pa_f4): the pressure into the last array, and what `read` returns,
   but for the first. */
static PyObject *sum_cycle(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const int places[] = {1, 0, 2, 4}; /* of the arrays among the arguments */
    static const Py_ssize_t sizes[] = {1, 8, 24, 4};
    Py_buffer views[4];
    int n_views = 0;
    Sums sums = {0, 0, 0, {0.0, 0.0, 0.0}};
    if (counted(n_arguments, 5) < 0)
        return NULL;
    double min_pressure_pa = PyFloat_AsDouble(arguments[3]), counted_pa[TAXELS * MOST_TRIANGLES];
    if (PyErr_Occurred())
        return NULL;
    for (; n_views < 4; n_views++)
        if (contiguous(arguments[places[n_views]], &views[n_views], n_views ? sizes[n_views] * views[0].len : -1, n_views == 3) < 0)
            goto end;
    Py_ssize_t n = views[0].len;
    const unsigned char *valid = views[0].buf;
    const double *pressure = views[1].buf;
    float *pressure_f4 = views[3].buf;
    if (n < 8 || n > TAXELS * MOST_TRIANGLES) {
        PyErr_Format(PyExc_ValueError, "expected 8 to %d taxels", TAXELS * MOST_TRIANGLES);
        goto end;
    }
    for (Py_ssize_t i = 0; i < n; i++) {
        pressure_f4[i] = (float)pressure[i];
        counted_pa[i] = valid[i] ? pressure[i] : 0.0;
        sums.n_valid += valid[i];
        sums.n_in_contact += valid[i] && pressure[i] >= min_pressure_pa;
    }
    sum_wrench(&sums, views[2].buf, counted_pa, n);
end:
    release(views, n_views);
    if (PyErr_Occurred())
        return NULL;
    return Py_BuildValue("llddd", sums.n_valid, sums.n_in_contact, sums.wrench[0], sums.wrench[1], sums.wrench[2]);
}

/* pads_on_rail(counts): whether any thermal pad of any triangle stands at 0 or 255. */
static PyObject *pads_on_rail(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer view;
    long found = 0;
    if (counted(n_arguments, 1) < 0 || contiguous(arguments[0], &view, -1, 0) < 0)
        return NULL;
    const unsigned char *counts = view.buf;
    for (Py_ssize_t at = 0; at + TAXELS <= view.len; at += TAXELS)
        found |= counts[at + 6] == 0 || counts[at + 6] == 255 || counts[at + 10] == 0 || counts[at + 10] == 255;
    PyBuffer_Release(&view);
    return PyBool_FromLong(found);
}

/* may_be_loose(counts, top_is_rail, loose): whether a triangle that is not loose has a thermal pad on a rail, or reads as
   a chip that answers 0. LooseTriangles says what that means. */
static PyObject *may_be_loose(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[3];
    int n_views = 0;
    long found = 0;
    if (counted(n_arguments, 3) < 0 || contiguous(arguments[0], &views[0], -1, 0) < 0)
        return NULL;
    Py_ssize_t n = views[0].len / TAXELS;
    for (n_views = 1; n_views < 3; n_views++)
        if (contiguous(arguments[n_views], &views[n_views], n, 0) < 0)
            goto end;
    found = may_any_be_loose(views[0].buf, views[1].buf, views[2].buf, n);
end:
    release(views, n_views);
    return PyErr_Occurred() ? NULL : PyBool_FromLong(found);
}

/* press(pressure_pa, valid, order, ends, seconds, peaks, integrals): takes the highest pressure (float32) of each region,
   where invalid taxels bear 0, into its peak and, for `seconds`, its integral; taxels of a region stand one after the other
   in `order`, up to its end. Returns how many are valid. */
static PyObject *press(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[6];
    int n_views = 0;
    long n_valid = 0;
    if (counted(n_arguments, 7) < 0)
        return NULL;
    double seconds = PyFloat_AsDouble(arguments[4]);
    if (PyErr_Occurred())
        return NULL;
    for (; n_views < 6; n_views++)
        if (contiguous(arguments[n_views + (n_views >= 4)], &views[n_views], -1, n_views >= 4) < 0)
            goto end;
    Py_ssize_t n_taxels = views[1].len, n_order = views[2].len / 8, n_regions = views[3].len / 8, at = 0;
    const float *pressure = views[0].buf;
    const unsigned char *valid = views[1].buf;
    const int64_t *order = views[2].buf, *ends = views[3].buf;
    double *peaks = views[4].buf, *integrals = views[5].buf;
    if (views[0].len != 4 * n_taxels || views[4].len != 8 * n_regions || views[5].len != 8 * n_regions
        || (n_regions && ends[n_regions - 1] != n_order)) {
        PyErr_SetString(PyExc_ValueError, "expected a pressure and a mark of each taxel, and a peak of each region");
        goto end;
    }
    for (Py_ssize_t region = 0; region < n_regions; region++) {
        float peak = 0.0F;
        for (Py_ssize_t first = at; at < ends[region] && at < n_order; at++) {
            int64_t taxel = order[at];
            if (taxel < 0 || taxel >= n_taxels) {
                PyErr_SetString(PyExc_ValueError, "expected the numbers of taxels");
                goto end;
            }
            float bears = valid[taxel] ? pressure[taxel] : 0.0F;
            n_valid += valid[taxel] != 0;
            if (at == first || bears > peak)
                peak = bears;
        }
        if (!(peaks[region] >= peak))
            peaks[region] = peak;
        integrals[region] += peak * seconds;
    }
end:
    release(views, n_views);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(n_valid);
}

/* activate(counts, level, top_is_rail, usable, board, clip, activation, at_top, total, n_at_top): as Rest.update, into the
   last four arrays. Returns whether any taxel is at the top. */
static PyObject *activate(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[] = {4, 4, 1, 1, 8, 0, 4, 1};
    Py_buffer views[10];
    int n_views = 0, any = 0;
    if (counted(n_arguments, 10) < 0)
        return NULL;
    for (; n_views < 10; n_views++) {
        Py_ssize_t size = n_views == 5 ? 8 : n_views == 0 || n_views == 8 ? -1
                        : n_views == 9 ? views[8].len : sizes[n_views] * (views[0].len / 4);
        if (contiguous(arguments[n_views], &views[n_views], size, n_views > 5) < 0)
            goto end;
    }
    Py_ssize_t n = views[0].len / 4, n_boards = views[8].len / 8;
    const float *count = views[0].buf, *level = views[1].buf, *clip = views[5].buf;
    const unsigned char *top_is_rail = views[2].buf, *usable = views[3].buf;
    const int64_t *board = views[4].buf;
    float *activation = views[6].buf;
    unsigned char *at_top = views[7].buf;
    double *total = views[8].buf, *n_at_top = views[9].buf;
    memset(total, 0, (size_t)views[8].len);
    memset(n_at_top, 0, (size_t)views[9].len);
    for (Py_ssize_t i = 0; i < n; i++) {
        if (board[i] < 0 || board[i] >= n_boards) {
            PyErr_SetString(PyExc_ValueError, "expected the numbers of boards");
            goto end;
        }
        float above = activation[i] = level[i] - count[i];
        above = above < clip[0] ? clip[0] : above > clip[1] ? clip[1] : above;
        any |= at_top[i] = count[i] == 255.0F && top_is_rail[i];
        total[board[i]] += usable[i] ? above : 0.0F;
        n_at_top[board[i]] += usable[i] && at_top[i];
    }
end:
    release(views, n_views);
    return PyErr_Occurred() ? NULL : PyBool_FromLong(any);
}

/* compare(activation, neighbours, live, state, for_dead, for_stuck, limits): adds to the evidence for dead and stuck taxels as
   TaxelFaults._compare does where no taxel is faulty. `limits`: loaded, share, idle, contrast, sharp, one look, evidence.
   Returns the most evidence for each. */
static PyObject *compare(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[7];
    int n_views = 0;
    float most_dead = 0.0F, most_stuck = 0.0F;
    if (counted(n_arguments, 7) < 0)
        return NULL;
    static const Py_ssize_t sizes[] = {4, 32, 1, 1, 4, 4};
    for (; n_views < 7; n_views++) {
        Py_ssize_t size = n_views == 0 ? -1 : n_views == 6 ? 7 * 4 : sizes[n_views] * (views[0].len / 4);
        if (contiguous(arguments[n_views], &views[n_views], size, n_views == 4 || n_views == 5) < 0)
            goto end;
    }
    Py_ssize_t n = views[0].len / 4;
    const float *activation = views[0].buf, *limits = views[6].buf;
    const int64_t *neighbours = views[1].buf;
    const unsigned char *live = views[2].buf, *state = views[3].buf;
    float *for_dead = views[4].buf, *for_stuck = views[5].buf;
    int all_well = 1;
    for (Py_ssize_t i = 0; i < n; i++) {
        all_well &= live[i] && !state[i];
        for (int k = 0; k < 4; k++)
            if (neighbours[k * n + i] < 0 || neighbours[k * n + i] >= n) {
                PyErr_SetString(PyExc_ValueError, "expected the numbers of taxels");
                goto end;
            }
    }
    for (Py_ssize_t i = 0; i < n; i++) {
        float least = INFINITY, sum = 0.0F, highest = 0.0F;
        int n_there = 0;
        for (int k = 0; k < 4; k++) {
            int64_t other = neighbours[k * n + i];
            float borne = 0.0F;
            if (live[other] && !state[other]) {
                borne = activation[other];
                least = borne < least ? borne : least;
                n_there++;
            }
            sum = k ? sum + borne : borne;
            highest = fabsf(borne) > highest ? fabsf(borne) : highest;
        }
        int judged = live[i] && n_there >= 2;
        float above = highest - limits[2], over = limits[4] * (above > 0 ? above : 0), added;
        if (judged && least >= limits[0]) {
            added = limits[1] * least - activation[i];
            for_dead[i] += added < limits[5] ? added : limits[5];
        }
        if (all_well) {
            added = fabsf(activation[i] - sum / 4.0F) - limits[3] - over;
            for_stuck[i] += added < limits[5] ? added : limits[5];
        } else { /* numpy divides by an integer here, and goes on in double precision */
            double more = fabs(activation[i] - (double)sum / (n_there ? n_there : 1)) - limits[3] - over;
            more = judged ? more : 0.0;
            for_stuck[i] = (float)(for_stuck[i] + (more < limits[5] ? more : limits[5]));
        }
        for_dead[i] = for_dead[i] < 0 ? 0 : for_dead[i] > limits[6] ? limits[6] : for_dead[i];
        for_stuck[i] = for_stuck[i] < 0 ? 0 : for_stuck[i] > limits[6] ? limits[6] : for_stuck[i];
        most_dead = for_dead[i] > most_dead ? for_dead[i] : most_dead;
        most_stuck = for_stuck[i] > most_stuck ? for_stuck[i] : most_stuck;
    }
end:
    release(views, n_views);
    return PyErr_Occurred() ? NULL : Py_BuildValue("ff", most_dead, most_stuck);
}

static PyMethodDef methods[] = {
    {"pack", (PyCFunction)(void (*)(void))pack, METH_FASTCALL, NULL},
    {"receiver", (PyCFunction)(void (*)(void))make_receiver, METH_FASTCALL, NULL},
    {"receive", (PyCFunction)(void (*)(void))receive, METH_FASTCALL, NULL},
    {"drain", (PyCFunction)(void (*)(void))drain, METH_FASTCALL, NULL},
    {"merge", (PyCFunction)(void (*)(void))merge, METH_FASTCALL, NULL},
    {"slots", (PyCFunction)(void (*)(void))slots, METH_FASTCALL, NULL},
    {"assembly", (PyCFunction)(void (*)(void))make_assembly, METH_FASTCALL, NULL},
    {"feed", (PyCFunction)(void (*)(void))feed, METH_FASTCALL, NULL},
    {"advance", (PyCFunction)(void (*)(void))advance, METH_FASTCALL, NULL},
    {"sorter", (PyCFunction)(void (*)(void))make_sorter, METH_FASTCALL, NULL},
    {"take", (PyCFunction)(void (*)(void))take, METH_FASTCALL, NULL},
    {"expected", (PyCFunction)(void (*)(void))expected_of_all, METH_FASTCALL, NULL},
    {"reader", (PyCFunction)(void (*)(void))make_reader, METH_FASTCALL, NULL},
    {"pads_on_rail", (PyCFunction)(void (*)(void))pads_on_rail, METH_FASTCALL, NULL},
    {"may_be_loose", (PyCFunction)(void (*)(void))may_be_loose, METH_FASTCALL, NULL},
    {"activate", (PyCFunction)(void (*)(void))activate, METH_FASTCALL, NULL},
    {"compare", (PyCFunction)(void (*)(void))compare, METH_FASTCALL, NULL},
    {"press", (PyCFunction)(void (*)(void))press, METH_FASTCALL, NULL},
    {"read", (PyCFunction)(void (*)(void))read_cycle, METH_FASTCALL, NULL},
    {"inverse", (PyCFunction)(void (*)(void))make_inverse, METH_FASTCALL, NULL},
    {"sum", (PyCFunction)(void (*)(void))sum_cycle, METH_FASTCALL, NULL},
    {"invert", (PyCFunction)(void (*)(void))invert, METH_FASTCALL, NULL},
    {"messages", (PyCFunction)(void (*)(void))make_messages, METH_FASTCALL, NULL},
    {"read_record", (PyCFunction)(void (*)(void))read_record, METH_FASTCALL, NULL},
    {"pack_record", (PyCFunction)(void (*)(void))pack_record, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && PyModule_AddIntConstant(module, "INTERFACE", INTERFACE) < 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
