// SPDX-License-Identifier: Apache-2.0
// Start-up of a Cortex-A7 or A15 in SVC mode, as `qemu-system-arm -M virt` begins it: floating
// point on, 4 GiB mapped (device memory, then RAM), caches on, stack, cleared data, main.
  .syntax unified
  .arm
  .global _start
  .section .start, "ax"
_start:
  cpsid if
  mrc p15, 0, r0, c0, c0, 5  // the other cores sleep
  ands r0, r0, #3
0: wfene
  bne 0b
  mrc p15, 0, r0, c1, c0, 2  // floating point and vectors do not trap
  orr r0, r0, #0xf00000
  mcr p15, 0, r0, c1, c0, 2
  isb
  mov r0, #0x40000000
  vmsr fpexc, r0

  // 4096 sections of 1 MiB: the first 1024 device memory, the others normal memory, write-back,
  // shareable.
  ldr r0, =map
  mov r1, #0
  ldr r2, =0x00c06           // section, device, full access
1: cmp r1, #1024
  ldreq r2, =0x11c0e         // section, normal write-back allocate, shareable, full access
  orr r3, r2, r1, lsl #20
  str r3, [r0, r1, lsl #2]
  add r1, r1, #1
  cmp r1, #4096
  bne 1b
  mcr p15, 0, r0, c2, c0, 0  // TTBR0
  mov r1, #0
  mcr p15, 0, r1, c2, c0, 2  // TTBCR: TTBR0 for all addresses
  mov r1, #1
  mcr p15, 0, r1, c3, c0, 0  // domain 0: sections decide
  mov r1, #0
  mcr p15, 0, r1, c8, c7, 0  // TLB
  mcr p15, 0, r1, c7, c5, 0  // instruction cache
  dsb
  isb
  mrc p15, 0, r1, c1, c0, 0
  ldr r2, =0x1005            // address translation, data cache, instruction cache
  orr r1, r1, r2
  bic r1, r1, #2             // unaligned access is allowed
  mcr p15, 0, r1, c1, c0, 0
  isb

  ldr sp, =stack_top
  ldr r0, =bss_begin
  ldr r1, =bss_end
  mov r2, #0
2: cmp r0, r1
  strlo r2, [r0], #4
  blo 2b
  bl main
  bl finish
  ldr r0, =0x84000008        // PSCI SYSTEM_OFF
  .arch_extension virt
  hvc #0
3: b 3b
  .ltorg

  .section .map, "aw", %nobits // not cleared with .bss, as it is in use by then
  .balign 16384
map: .skip 16384
