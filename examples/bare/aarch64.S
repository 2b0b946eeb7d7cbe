// SPDX-License-Identifier: Apache-2.0
// Start-up of a Cortex-A53 or later in EL1, as `qemu-system-aarch64 -M virt` begins it: floating
// point on, the first 4 GiB mapped (device memory, then RAM), caches on, stack, cleared data, main.
  .global _start
  .section .start, "ax"
_start:
  mrs x0, mpidr_el1          // the other cores sleep
  and x0, x0, #3
  cbz x0, 1f
0: wfe
  b 0b
1: mov x0, #3 << 20          // floating point and vectors do not trap
  msr cpacr_el1, x0
  isb

  // One table of four 1 GiB blocks. Attribute 0: device memory. Attribute 1: normal memory,
  // write-back.
  adrp x0, map
  mov x1, #0x401             // block, accessed, attribute 0
  str x1, [x0]
  mov x1, #0x705             // block, accessed, inner shareable, attribute 1
  mov x2, #1
2: add x3, x1, x2, lsl #30
  str x3, [x0, x2, lsl #3]
  add x2, x2, #1
  cmp x2, #4
  b.ne 2b
  mov x1, #0xff00
  msr mair_el1, x1
  ldr x1, =0x80803520        // 32-bit addresses through TTBR0 only, cached, 4 KiB granule
  msr tcr_el1, x1
  msr ttbr0_el1, x0
  dsb sy
  tlbi vmalle1
  dsb sy
  isb
  mrs x1, sctlr_el1
  mov x2, #0x1005            // address translation, data cache, instruction cache
  orr x1, x1, x2
  bic x1, x1, #2             // unaligned access is allowed
  msr sctlr_el1, x1
  isb

  ldr x0, =stack_top
  mov sp, x0
  ldr x0, =bss_begin
  ldr x1, =bss_end
3: cmp x0, x1
  b.hs 4f
  stp xzr, xzr, [x0], #16
  b 3b
4: bl main
  bl finish
  ldr x0, =0x84000008        // PSCI SYSTEM_OFF
  hvc #0
5: b 5b

  .section .map, "aw", %nobits // not cleared with .bss, as it is in use by then
  .balign 4096
map: .skip 4096
