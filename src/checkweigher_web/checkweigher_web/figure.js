// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// A figure of ECharts. Its options come as one text, which the server makes once for all viewers.
import { echarts } from "nicegui-echart";

export default {
  template: "<div></div>",
  props: { text: String },
  watch: {
    text() {
      this.draw();
    },
  },
  mounted() {
    this.resized = new ResizeObserver(() => {
      // ECharts asks for a size when it begins.
      if (!this.chart && this.$el.clientWidth) this.chart = echarts.init(this.$el);
      this.chart?.resize();
      if (this.shown !== this.text) this.draw();
    });
    this.resized.observe(this.$el);
  },
  beforeUnmount() {
    this.resized.disconnect();
    this.chart?.dispose();
  },
  methods: {
    draw() {
      if (!this.chart) return;
      this.shown = this.text;
      this.chart.setOption(JSON.parse(this.text), { notMerge: true });
    },
  },
};
