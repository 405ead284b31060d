/* The arithmetic of a cycle, compiled: the same results, to the bit, as the numpy code that calls it.

   pack         a map of fixed keys as msgpack
   receive      what waits in a socket, by the hundred; drain: into arrays, with both clocks
   slots        the slot of each frame
   assembly     the state of a CycleAssembler; feed: frames into it; close: a cycle out of it
   reader       the constants of a foot; read: counts into valid taxels, pressure and the sums of the wrench
   pads_on_rail, may_be_loose: whether a triangle may just have come loose
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

#define INTERFACE 3 /* another number for other functions or arguments; compiled.py has it too */
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

/* receive(fd, headers, held): recvmmsg into the headers that are not held yet, without blocking; how many frames are
   held then, or minus the error number. */
static PyObject *receive(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer headers;
    if (counted(n_arguments, 3) < 0)
        return NULL;
    long fd = PyLong_AsLong(arguments[0]), held = PyLong_AsLong(arguments[2]);
    if (PyErr_Occurred() || contiguous(arguments[1], &headers, -1, 1) < 0)
        return NULL;
    long room = (long)(headers.len / (Py_ssize_t)sizeof(struct mmsghdr)) - held;
    if (held >= 0 && room > 0) {
        int taken = recvmmsg((int)fd, (struct mmsghdr *)headers.buf + held, (unsigned)room, MSG_DONTWAIT, NULL);
        held = taken >= 0 ? held + taken : errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? held : -errno;
    }
    PyBuffer_Release(&headers);
    return PyLong_FromLong(held);
}

/* drain(frames, control, headers, offset_ns, last_mono_ns, now_mono_ns, raw, t_ns, t_mono_ns): the frames held, as many as
   `raw` has rows of 16 bytes, into the last three arrays. Returns (how many have a time stamp, how many are standard data
   frames of 8 bytes, the kernel's count of lost frames or None, the last monotonic time). */
static PyObject *drain(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[6];
    int n_views = 0;
    PyObject *result = NULL;
    if (counted(n_arguments, 9) < 0)
        return NULL;
    int64_t offset_ns = PyLong_AsLongLong(arguments[3]), last_ns = PyLong_AsLongLong(arguments[4]),
            now_ns = PyLong_AsLongLong(arguments[5]);
    if (PyErr_Occurred() || contiguous(arguments[6], &views[0], -1, 1) < 0)
        return NULL;
    n_views = 1;
    Py_ssize_t n = views[0].len / 16;
    for (; n_views < 3; n_views++)
        if (contiguous(arguments[6 + n_views], &views[n_views], 8 * n, 1) < 0)
            goto end;
    for (; n_views < 6; n_views++)
        if (contiguous(arguments[n_views - 3], &views[n_views], -1, 1) < 0)
            goto end;
    if (n < 1 || views[3].len < 16 * n || views[4].len < CONTROL_BYTES * n
        || views[5].len < (Py_ssize_t)sizeof(struct mmsghdr) * n) {
        PyErr_SetString(PyExc_ValueError, "expected room for the frames that are held, of which there are some");
        goto end;
    }
    char *raw = views[0].buf;
    int64_t *t_ns = views[1].buf, *t_mono_ns = views[2].buf;
    const int64_t *control = views[4].buf;
    struct mmsghdr *headers = views[5].buf;
    memcpy(raw, views[3].buf, (size_t)(16 * n));
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
        memcpy(&head, raw + 16 * i, 8);
        plain += head >> 11 == ((uint64_t)8 << 32) >> 11;
        stamped += stamp[1] == STAMP_HEADER;
        t_ns[i] = stamp[2] * 1000000000 + stamp[3];
        if (t_ns[i] + offset_ns > last_ns)
            last_ns = t_ns[i] + offset_ns;
        t_mono_ns[i] = last_ns < now_ns ? last_ns : now_ns;
        headers[i].msg_hdr.msg_controllen = CONTROL_BYTES;
    }
    result = Py_BuildValue("llNL", stamped, plain, lost, (long long)t_mono_ns[n - 1]);
end:
    release(views, n_views);
    return result;
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

/* --- assembly ------------------------------------------------------------------------------------------------ */

enum { SEEN, EXPECTED, RETURNING, MISSES, ARRIVALS, CHANGES, PAYLOAD, T_NS, T_MONO_NS, NEWEST_SLOT, BOARD, N_STATE };

typedef struct {
    Py_buffer views[N_STATE];
    Py_ssize_t n_slots, first_slot;
    int64_t limit_ns, twice_ns;
} Assembly;

static void free_assembly(PyObject *capsule)
{
    Assembly *assembly = PyCapsule_GetPointer(capsule, "assembly");
    release(assembly->views, N_STATE);
    PyMem_Free(assembly);
}

/* assembly(arrays, first_slot, limit_ns, twice_ns): `arrays` in the order of the enum, written to from then on. */
static PyObject *make_assembly(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[N_STATE] = {1, 1, 1, 8, 8, 8, 8, 8, 8, 0, 8};
    if (counted(n_arguments, 4) < 0)
        return NULL;
    if (PyTuple_Size(arguments[0]) != N_STATE) {
        if (!PyErr_Occurred())
            PyErr_Format(PyExc_ValueError, "expected %d arrays", N_STATE);
        return NULL;
    }
    Assembly *assembly = PyMem_Malloc(sizeof *assembly);
    if (assembly == NULL)
        return PyErr_NoMemory();
    assembly->first_slot = PyLong_AsSsize_t(arguments[1]);
    assembly->limit_ns = PyLong_AsLongLong(arguments[2]);
    assembly->twice_ns = PyLong_AsLongLong(arguments[3]);
    int held = 0;
    if (PyErr_Occurred())
        goto failed;
    for (; held < N_STATE; held++) {
        Py_ssize_t size = held && sizes[held] ? sizes[held] * assembly->n_slots : -1;
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

/* feed(assembly, slots, data, t_ns, t_mono_ns, start, due_ns, outstanding, waiting):
   frames from row `start` on, until the last expected half has come, or one is past `due_ns` (None: nothing has come
   yet). Returns (row, due_ns, outstanding, newest_t_ns, fresh, superseded): `row` is the first that was not taken;
   newest_t_ns is None where none of this foot was. `waiting`: whether any half is expected. */
static PyObject *feed(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    Py_buffer views[4];
    int n_views = 0;
    PyObject *result = NULL;
    if (counted(n_arguments, 9) < 0)
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
    Py_ssize_t row = PyLong_AsSsize_t(arguments[5]);
    int begun = arguments[6] != Py_None;
    int64_t due_ns = begun ? PyLong_AsLongLong(arguments[6]) : 0;
    int64_t outstanding = PyLong_AsLongLong(arguments[7]);
    int waiting = PyObject_IsTrue(arguments[8]);
    if (PyErr_Occurred())
        goto end;
    const int16_t *slot_of = views[0].buf;
    const char *data = views[1].buf;
    Py_ssize_t data_step = views[1].strides[0];
    const int64_t *t_ns = views[2].buf, *t_mono_ns = views[3].buf;
    Py_buffer *state = assembly->views;
    unsigned char *seen = state[SEEN].buf, *expected = state[EXPECTED].buf, *returning = state[RETURNING].buf;
    int64_t *misses = state[MISSES].buf, *arrivals = state[ARRIVALS].buf, *changes = state[CHANGES].buf;
    uint64_t *payload = state[PAYLOAD].buf;
    int64_t *last_ns = state[T_NS].buf, *last_mono_ns = state[T_MONO_NS].buf;
    int16_t *newest_slot = state[NEWEST_SLOT].buf;
    const int64_t *board = state[BOARD].buf;
    int64_t newest_t_ns = 0, superseded = 0;
    int any = 0, fresh = 0;
    for (; row < n && !(waiting && outstanding == 0); row++) {
        Py_ssize_t slot = slot_of[row] - assembly->first_slot;
        if (slot < 0 || slot >= assembly->n_slots)
            continue;
        int64_t now_ns = t_mono_ns[row];
        if (!begun) {
            due_ns = now_ns + assembly->limit_ns;
            begun = 1;
        }
        if (now_ns > due_ns)
            break;
        int64_t since_ns = now_ns - last_mono_ns[slot];
        int once_more = since_ns < assembly->twice_ns && newest_slot[board[slot]] == slot;
        if (!once_more) {
            fresh = 1;
            if (since_ns <= assembly->limit_ns) {
                misses[slot] = 0;
                returning[slot] = 1;
            }
        }
        if (!once_more && !seen[slot]) {
            seen[slot] = 1;
            outstanding -= expected[slot];
        } else
            superseded++;
        uint64_t bytes;
        memcpy(&bytes, data + row * data_step, 8);
        arrivals[slot]++;
        changes[slot] += bytes != payload[slot];
        payload[slot] = bytes;
        newest_t_ns = last_ns[slot] = t_ns[row];
        last_mono_ns[slot] = now_ns;
        newest_slot[board[slot]] = (int16_t)slot;
        any = 1;
    }
    PyObject *due = begun ? PyLong_FromLongLong(due_ns) : Py_NewRef(Py_None);
    PyObject *newest = any ? PyLong_FromLongLong(newest_t_ns) : Py_NewRef(Py_None);
    result = Py_BuildValue("nNLNiL", row, due, (long long)outstanding, newest, fresh, (long long)superseded);
end:
    release(views, n_views);
    return result;
}

/* close(assembly, t_close_ns, counts, status, triangle_t_ns, age_ns, arrivals, missing): the cycle as it stands into the
   six arrays, as in Cycles; then the next one begins. Returns how many halves that expects. */
static PyObject *close_cycle(PyObject *module, PyObject *const *arguments, Py_ssize_t n_arguments)
{
    static const Py_ssize_t sizes[] = {TAXELS, 2, 8, 8, 8, 1};
    Py_buffer views[6];
    int n_views = 0;
    PyObject *result = NULL;
    if (counted(n_arguments, 8) < 0)
        return NULL;
    Assembly *assembly = PyCapsule_GetPointer(arguments[0], "assembly");
    if (assembly == NULL)
        return NULL;
    int64_t t_close_ns = PyLong_AsLongLong(arguments[1]);
    if (t_close_ns == -1 && PyErr_Occurred())
        return NULL;
    Py_ssize_t n = assembly->n_slots / 2;
    for (; n_views < 6; n_views++)
        if (contiguous(arguments[2 + n_views], &views[n_views], sizes[n_views] * n, 1) < 0)
            goto end;
    unsigned char *counts = views[0].buf, *missing = views[5].buf;
    uint16_t *status = views[1].buf;
    int64_t *triangle_t_ns = views[2].buf, *age_ns = views[3].buf, *arrivals = views[4].buf;
    Py_buffer *state = assembly->views;
    unsigned char *seen = state[SEEN].buf, *expected = state[EXPECTED].buf, *returning = state[RETURNING].buf;
    const int64_t *received = state[ARRIVALS].buf, *t_ns = state[T_NS].buf, *t_mono_ns = state[T_MONO_NS].buf;
    const unsigned char *payload = state[PAYLOAD].buf;
    for (Py_ssize_t i = 0; i < n; i++) {
        const unsigned char *a = payload + 16 * i, *b = a + 8;
        memcpy(counts + TAXELS * i, a + 1, 7);
        memcpy(counts + TAXELS * i + 7, b + 1, 5);
        status[i] = (uint16_t)(b[6] << 8 | b[7]);
        Py_ssize_t older = t_mono_ns[2 * i] <= t_mono_ns[2 * i + 1] ? 2 * i : 2 * i + 1;
        triangle_t_ns[i] = t_ns[older];
        age_ns[i] = t_mono_ns[older] == NEVER ? -1 : t_close_ns - t_mono_ns[older];
        arrivals[i] = received[2 * i] + received[2 * i + 1];
        missing[i] = (expected[2 * i] && !seen[2 * i]) || (expected[2 * i + 1] && !seen[2 * i + 1]);
    }
    long n_expected = 0;
    for (Py_ssize_t slot = 0; slot < assembly->n_slots; slot++) {
        expected[slot] |= returning[slot];
        n_expected += expected[slot];
    }
    memset(returning, 0, (size_t)assembly->n_slots);
    memset(seen, 0, (size_t)assembly->n_slots);
    result = PyLong_FromLong(n_expected);
end:
    release(views, n_views);
    return result;
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
    Py_ssize_t n = reader->n_triangles, n_taxels = TAXELS * n;
    for (; n_views < 8; n_views++)
        if (contiguous(arguments[1 + n_views], &views[n_views], sizes[n_views] * n, n_views >= 4) < 0)
            goto end;
    const unsigned char *counts = views[0].buf, *masked = views[3].buf;
    const uint16_t *status = views[1].buf;
    const int64_t *age_ns = views[2].buf;
    unsigned char *valid = views[4].buf;
    double *pressure = views[5].buf;
    float *pressure_f4 = views[6].buf, *age_ms = views[7].buf;
    Py_buffer *constants = reader->views;
    const unsigned char *usable = constants[USABLE].buf, *n_readings = constants[N_READINGS].buf,
                        *rests_at_255 = constants[RESTS_AT_255].buf, *flags_work = constants[FLAGS_WORK].buf;
    const double *baseline = constants[BASELINE].buf, *lowest = constants[LOWEST].buf, *rows = constants[ROWS].buf;
    const double *last = (const double *)constants[COEFFICIENTS].buf + (reader->n_coefficients - 1) * n_taxels;
    double counted_pa[TAXELS * MOST_TRIANGLES], product[TAXELS * MOST_TRIANGLES], wrench[3];
    long n_valid = 0, n_in_contact = 0;
    int extrapolated = 0;
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
            extrapolated |= good && count < lowest[at];
            valid[at] = (unsigned char)good;
            pressure[at] = value;
            pressure_f4[at] = (float)value;
            counted_pa[at] = good ? value : 0.0;
            n_valid += good;
            n_in_contact += good && value >= reader->min_pressure_pa;
        }
    }
    for (int k = 0; k < 3; k++) {
        for (Py_ssize_t at = 0; at < n_taxels; at++)
            product[at] = rows[k * n_taxels + at] * counted_pa[at];
        wrench[k] = pairwise_sum(product, n_taxels);
    }
    result = Py_BuildValue("illddd", extrapolated, n_valid, n_in_contact, wrench[0], wrench[1], wrench[2]);
end:
    release(views, n_views);
    return result;
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
    const unsigned char *counts = views[0].buf, *top_is_rail = views[1].buf, *loose = views[2].buf;
    for (Py_ssize_t i = 0; i < n; i++, counts += TAXELS)
        found |= !loose[i] && (counts[6] == 0 || counts[10] == 0
                               || (top_is_rail[i] ? counts[6] == 255 || counts[10] == 255 : counts[9] == 0));
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
    {"receive", (PyCFunction)(void (*)(void))receive, METH_FASTCALL, NULL},
    {"drain", (PyCFunction)(void (*)(void))drain, METH_FASTCALL, NULL},
    {"slots", (PyCFunction)(void (*)(void))slots, METH_FASTCALL, NULL},
    {"assembly", (PyCFunction)(void (*)(void))make_assembly, METH_FASTCALL, NULL},
    {"feed", (PyCFunction)(void (*)(void))feed, METH_FASTCALL, NULL},
    {"close", (PyCFunction)(void (*)(void))close_cycle, METH_FASTCALL, NULL},
    {"reader", (PyCFunction)(void (*)(void))make_reader, METH_FASTCALL, NULL},
    {"pads_on_rail", (PyCFunction)(void (*)(void))pads_on_rail, METH_FASTCALL, NULL},
    {"may_be_loose", (PyCFunction)(void (*)(void))may_be_loose, METH_FASTCALL, NULL},
    {"compare", (PyCFunction)(void (*)(void))compare, METH_FASTCALL, NULL},
    {"press", (PyCFunction)(void (*)(void))press, METH_FASTCALL, NULL},
    {"read", (PyCFunction)(void (*)(void))read_cycle, METH_FASTCALL, NULL},
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
