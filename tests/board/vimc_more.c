// SPDX-License-Identifier: Apache-2.0
// Or, at your choice, GPL-2.0: this one file is a kernel module, and the kernel asks for that. The
// vimc driver makes one camera; this module, loaded after it, registers more of its platform
// devices. It is built for the virtual board only (tests/board) and never part of a program.
#include <linux/err.h>
#include <linux/module.h>
#include <linux/platform_device.h>

#define CAP_DEVICES 4

static int count = 2;
module_param(count, int, 0);
MODULE_PARM_DESC(count, "how many cameras more");

static struct platform_device *devices[CAP_DEVICES];

static int __init more_init(void) {
  int i;

  for (i = 0; i < count && i < CAP_DEVICES; i++) {
    struct platform_device *device = platform_device_register_simple("vimc", i + 1, NULL, 0);

    if (!IS_ERR(device)) devices[i] = device;
  }
  return 0;
}

static void __exit more_exit(void) {
  int i;

  for (i = 0; i < CAP_DEVICES; i++) platform_device_unregister(devices[i]);
}

module_init(more_init);
module_exit(more_exit);
MODULE_LICENSE("GPL");
