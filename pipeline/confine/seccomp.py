"""seccomp, a filter of system calls: afterwards the kernel refuses all calls that write, execute, connect or affect
other processes.

Python, USD and Numba can still read and compute, including threads and memory. Open files remain open as they are.

References
----------
https://docs.kernel.org/userspace-api/seccomp_filter.html
"""

import ctypes
import errno
import os
import platform
import struct
import sys

from pipeline.confine.kernel import FILTER_CALLS, NO_NEW_PRIVILEGES, prctl

_FILTER = 2
"""SECCOMP_MODE_FILTER of linux/seccomp.h."""
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
"""Instructions of a filter from linux/bpf_common.h: LD + W + ABS, JMP + JEQ, JMP + JGE, JMP + JSET, RET."""
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000
"""SECCOMP_RET_ALLOW, and SECCOMP_RET_ERRNO with the number of an error in its low half."""
_NUMBER, _MACHINE, _FIRST, _SECOND, _THIRD = 0, 4, 16, 24, 32
"""Offsets in struct seccomp_data [bytes]: number of the call, machine, low halves of the arguments."""
_X32 = 0x40000000
"""__X32_SYSCALL_BIT of asm/unistd.h: the same calls once more, for programs with short pointers."""
_A_THREAD = 0x10000
"""CLONE_THREAD of linux/sched.h."""
_TO_WRITE = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

# Numbers of the calls on x86_64 and aarch64; -1 where a machine has no such call.
_REFUSED = {
    "execve": (59, 221), "execveat": (322, 281), "fork": (57, -1), "vfork": (58, -1),
    "ptrace": (101, 117), "process_vm_readv": (310, 270), "process_vm_writev": (311, 271),
    "kill": (62, 129), "tkill": (200, 130), "pidfd_send_signal": (424, 424), "pidfd_getfd": (438, 438),
    "socket": (41, 198), "socketpair": (53, 199), "bind": (49, 200), "connect": (42, 203), "accept": (43, 202),
    "accept4": (288, 242), "listen": (50, 201),
    "creat": (85, -1), "truncate": (76, 45), "mknod": (133, -1), "mknodat": (259, 33),
    "mkdir": (83, -1), "mkdirat": (258, 34), "rmdir": (84, -1), "unlink": (87, -1), "unlinkat": (263, 35),
    "rename": (82, -1), "renameat": (264, 38), "renameat2": (316, 276),
    "link": (86, -1), "linkat": (265, 37), "symlink": (88, -1), "symlinkat": (266, 36),
    "chmod": (90, -1), "fchmod": (91, 52), "fchmodat": (268, 53), "fchmodat2": (452, 452),
    "chown": (92, -1), "lchown": (94, -1), "fchown": (93, 55), "fchownat": (260, 54),
    "utime": (132, -1), "utimes": (235, -1), "utimensat": (280, 88), "futimesat": (261, -1),
    "setxattr": (188, 5), "lsetxattr": (189, 6), "fsetxattr": (190, 7),
    "removexattr": (197, 14), "lremovexattr": (198, 15), "fremovexattr": (199, 16),
    "mount": (165, 40), "umount2": (166, 39), "pivot_root": (155, 41), "chroot": (161, 51), "move_mount": (429, 429),
    "open_tree": (428, 428), "fsopen": (430, 430), "fsmount": (432, 432), "mount_setattr": (442, 442),
    "unshare": (272, 97), "setns": (308, 268), "open_by_handle_at": (304, 265), "io_uring_setup": (425, 425),
    "bpf": (321, 280), "perf_event_open": (298, 241), "userfaultfd": (323, 282), "keyctl": (250, 219),
    "add_key": (248, 217), "request_key": (249, 218), "init_module": (175, 105), "finit_module": (313, 273),
    "kexec_load": (246, 104), "reboot": (169, 142), "swapon": (167, 224), "quotactl": (179, 60), "acct": (163, 89),
    "setrlimit": (160, 164), "prctl": (157, 167), "setuid": (105, 146), "setgid": (106, 144),
    "ioperm": (173, -1), "iopl": (172, -1), "sethostname": (170, 161), "settimeofday": (164, 170),
}  # fmt: skip
_UNKNOWN = {"clone3": (435, 435), "openat2": (437, 437)}
"""Calls whose arguments are in memory, where no filter can look; they are reported as unknown, and C libraries use
the older calls.
"""
_LIMITED = {
    "open": (2, -1, _SECOND, _TO_WRITE),
    "openat": (257, 56, _THIRD, _TO_WRITE),
    "prlimit64": (302, 261, _THIRD, 0xFFFFFFFF),
}
"""Arguments of calls and their forbidden bits: ways to open a file, address of new limits."""
_CLONE = (56, 220)
"""Number of clone on x86_64 and aarch64: it may only create threads."""
_MACHINES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}


def restrict() -> bool:
    """Forbid this thread, and everything that it starts, all calls that write, execute or connect; whether that is
    in force.
    """
    found = _MACHINES.get(platform.machine())
    if sys.platform != "linux" or found is None:
        return False
    program = b"".join(_program(*found))
    buffer = ctypes.create_string_buffer(program, len(program))
    described = struct.pack("@HP", len(program) // 8, ctypes.addressof(buffer))
    prctl(NO_NEW_PRIVILEGES, 1)
    return prctl(FILTER_CALLS, _FILTER, ctypes.create_string_buffer(described, len(described)))


def _program(column: int, machine: int) -> list[bytes]:
    """The filter: a sequence of tests, each with its consequence."""
    refuse, unknown = _statement(_RETURN, _REFUSE | errno.EPERM), _statement(_RETURN, _REFUSE | errno.ENOSYS)
    allow = _statement(_RETURN, _ALLOW)
    steps = [_statement(_LOAD, _MACHINE), _jump(_EQUAL, machine, 1, 0), refuse, _statement(_LOAD, _NUMBER)]
    if column == 0:
        steps += [_jump(_AT_LEAST, _X32, 0, 1), unknown]
    for numbers, answer in ((_REFUSED, refuse), (_UNKNOWN, unknown)):
        for places in numbers.values():
            steps += [_jump(_EQUAL, places[column], 0, 1), answer] if places[column] >= 0 else []
    for *numbers_of_it, argument, bits in _LIMITED.values():
        if (number := numbers_of_it[column]) >= 0:
            steps += [_jump(_EQUAL, number, 0, 4), _statement(_LOAD, argument)]
            steps += [_jump(_ANY_BIT, bits, 0, 1), refuse, allow]
    steps += [_jump(_EQUAL, _CLONE[column], 0, 3), _statement(_LOAD, _FIRST), _jump(_ANY_BIT, _A_THREAD, 1, 0), refuse]
    return [*steps, allow]


def _statement(code: int, value: int) -> bytes:
    return _jump(code, value, 0, 0)


def _jump(code: int, value: int, if_true: int, if_false: int) -> bytes:
    return struct.pack("=HBBI", code, if_true, if_false, value)
