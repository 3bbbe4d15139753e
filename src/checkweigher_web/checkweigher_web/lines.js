// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// List of lines, which are one text in JSON.
export default {
  template: `<ol><li v-for="line in list">{{ line }}</li></ol>`,
  props: { lines: { type: String, default: "[]" } },
  computed: {
    list() {
      return JSON.parse(this.lines);
    },
  },
};
