// SPDX-License-Identifier: Apache-2.0
// The weights as part of the program: nothing to find at run time. The path is that from the root
// of the tree, where the compiler is started.
#include "tools/metric/lpips_weights.h"

__asm__(".pushsection .rodata\n"
        ".balign 64\n"
        ".global sv_lpips_weights, sv_lpips_weights_end\n"
        "sv_lpips_weights:\n"
        ".incbin \"tools/weights/lpips_squeeze.bin\"\n"
        "sv_lpips_weights_end:\n"
        ".popsection\n");

size_t sv_lpips_weights_bytes(void) { return (size_t)(sv_lpips_weights_end - sv_lpips_weights); }
