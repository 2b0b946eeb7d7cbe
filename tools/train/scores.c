// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>

#include "tools/train/evaluate.h"

static const char *const own_keys[] = {"mask_coverage", "masked_views", "mpsnr", "mssim", "mlpips"},
                         *const shared_keys[] = {"shared_coverage", "shared_views", "shared_psnr",
                                                 "shared_ssim", "shared_lpips"},
                         *const support_keys[] = {"support_coverage", "supported_views", "supported_psnr",
                                                  "supported_ssim", "supported_lpips"};

static void report_masked(lab_report *j, const lab_masked_scores *m, const char *const keys[5],
                          bool has_lpips) {
  lab_report_num(j, keys[0], m->coverage);
  lab_report_int(j, keys[1], m->n);
  if (!m->n) return;
  lab_report_num(j, keys[2], m->psnr);
  lab_report_num(j, keys[3], m->ssim);
  if (has_lpips) lab_report_num(j, keys[4], m->lpips);
}

void lab_scores_report(lab_report *j, const lab_scores *s) {
  lab_report_num(j, "psnr", s->psnr);
  lab_report_num(j, "ssim", s->ssim);
  if (s->has_lpips) lab_report_num(j, s->is_vgg ? "lpips_vgg" : "lpips_squeeze", s->lpips);
  if (s->n_depth) {
    lab_report_num(j, "abs_rel", s->abs_rel);
    lab_report_num(j, "rmse", s->rmse);
  }
  if (s->is_aligned) { // how far the held-out poses were refined before scoring
    lab_report_num(j, "aligned_deg", s->turned_deg);
    lab_report_num(j, "aligned_shift", s->shifted);
  }
  if (s->n_with_mask) {
    lab_report_int(j, "views_with_mask", s->n_with_mask);
    lab_report_num(j, "unmasked", s->counted);
  }
  if (s->is_by_support) report_masked(j, &s->masked[LAB_MASK_OWN], support_keys, s->has_lpips);
  else if (s->covisible_by) {
    lab_report_text(j, "covisible_by", s->covisible_by);
    report_masked(j, &s->masked[LAB_MASK_OWN], own_keys, s->has_lpips);
  }
  if (s->n_masks > LAB_MASK_SHARED) report_masked(j, &s->masked[LAB_MASK_SHARED], shared_keys, s->has_lpips);
  lab_report_int(j, "views", s->n);
}

void lab_scores_print(const lab_scores *s) {
  printf("PSNR %.2f dB, SSIM %.4f", s->psnr, s->ssim);
  if (s->has_lpips) printf(", LPIPS%s %.4f", s->is_vgg ? " (VGG)" : "", s->lpips);
  if (s->n_depth) printf(", depth AbsRel %.4f, RMSE %.4f", s->abs_rel, s->rmse);
  if (s->n_with_mask) printf(" over the %.1f %% of the pixels that masks leave", 100 * s->counted);
  if (s->is_aligned)
    printf(" with held-out poses refined against the model, by %.3f degrees and %.4g units in the mean",
           s->turned_deg, s->shifted);
  if (!s->covisible_by) return;
  for (int k = 0; k < s->n_masks; k++) {
    const lab_masked_scores *m = &s->masked[k];
    if (s->is_by_support) printf("; %.1f %% of the pixels well supported", 100 * m->coverage);
    else
      printf("; %.1f %% of the pixels co-visible %s%s", 100 * m->coverage,
             k == LAB_MASK_OWN ? "by " : "for all devices", k == LAB_MASK_OWN ? s->covisible_by : "");
    if (m->n) printf(": mPSNR %.2f dB, mSSIM %.4f", m->psnr, m->ssim);
    if (m->n && s->has_lpips) printf(", mLPIPS %.4f", m->lpips);
  }
}

void lab_time_scores_report(lab_report *j, const lab_scores *s) {
  lab_report_num(j, "time_psnr", s->psnr);
  lab_report_num(j, "time_ssim", s->ssim);
  if (s->has_lpips) lab_report_num(j, s->is_vgg ? "time_lpips_vgg" : "time_lpips_squeeze", s->lpips);
  if (s->n_depth) lab_report_num(j, "time_abs_rel", s->abs_rel);
  lab_report_int(j, "time_views", s->n);
}
