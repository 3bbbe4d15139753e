// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// Production figures with their course over time, and bars for the rules of the batch. A bar is
// full if the margin of its rule is used up. The content is one text in JSON, which the server makes
// once for all viewers.
export default {
  template: `
    <div class="figures">
      <div v-for="[name, value, points] in shown.figures" :key="name" class="number">
        <span>{{ name }}</span><b>{{ value }}</b>
        <svg viewBox="0 0 100 30" preserveAspectRatio="none" aria-hidden="true">
          <polyline :points="points"/></svg>
      </div>
      <div v-for="[name, text, used] in shown.rules" :key="name" class="rule">
        <span>{{ name }}: </span>
        <div class="bar" aria-hidden="true" v-if="used !== null">
          <i :class="{ broken: used > 1 }" :style="{ width: 100 * Math.min(used, 1) + '%' }"></i>
        </div>
        <span class="text">{{ text }}</span>
      </div>
    </div>`,
  props: { text: { type: String, default: "{}" } },
  computed: {
    shown() {
      return JSON.parse(this.text);
    },
  },
};
